/* What every tier needs before the templates. */
#ifndef DVSM_KERNELS_TIER_H
#define DVSM_KERNELS_TIER_H

#include <math.h>
#include <string.h>

#include "kernels/kernels.h"

#define DVSM_INLINE static inline __attribute__((always_inline))

/* Loops over a tile's registers must vanish, or the sums would live in memory. */
#if defined(__clang__)
#define DVSM_UNROLL   _Pragma("clang loop unroll(full)")
#define DVSM_UNROLL_4 _Pragma("clang loop unroll_count(4)")
#else
#define DVSM_UNROLL   _Pragma("GCC unroll 16")
#define DVSM_UNROLL_4 _Pragma("GCC unroll 4")
#endif

#endif
