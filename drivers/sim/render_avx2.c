/* The tracer for processors with AVX2: eight rays at a time. */
#define SIM_RENDER sim_render_linear_avx2
#define SIM_WIDE

#include "render.inc.h"
