/*
 * A 32 x 32 block of a product of bfloat16 matrices, summed in float32, and the calling thread's
 * state behind it: AMX tiles, or AVX-512 with or without AVX512-BF16 over the same packings
 * (vector.h). The build makes a library of each; tiles_supported() says whether this one's
 * instructions are there.
 *
 *	tiles_configure();                            once a thread, before the others
 *	tiles_zero();                                 or tiles_load(c, stride)
 *	tiles_multiply(a0, a1, stride, advance, panel, steps);
 *	tiles_store(c, stride);
 *	tiles_release();
 */
#pragma once

#ifdef __AMX_BF16__
#include "tiles_amx.h"
#else
#include "tiles_avx512.h"
#endif
