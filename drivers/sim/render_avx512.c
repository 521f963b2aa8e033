/* The tracer for processors with AVX-512: sixteen rays at a time. */
#define SIM_RENDER sim_render_linear_avx512
#define SIM_WIDE

#include "render.inc.h"
