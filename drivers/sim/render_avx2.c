/* The tracer once more, compiled for processors with AVX2. Every operation is rounded alike, so the
 * pictures have the same bits. */
#define sim_render_linear sim_render_linear_avx2

#include "render.c"
