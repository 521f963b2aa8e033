/* The tracer for every processor. */
#define SIM_RENDER sim_render_linear

#include "render.inc.h"
