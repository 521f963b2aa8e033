/* The tracer for processors with AVX2. */
#define SIM_RENDER sim_render_linear_avx2

#include "render.inc.h"
