/* What the fixed-point path does a row at a time, for Advanced SIMD. Private to the kernels. */
#ifndef DVSM_KERNELS_FIXED_NEON_ROWS_H
#define DVSM_KERNELS_FIXED_NEON_ROWS_H

#include "kernels/fixed.h"

dvsm_fixed_norm_fn dvsm_fixed_neon_norm;
dvsm_fixed_quantise_fn dvsm_fixed_neon_quantise;
dvsm_fixed_queries_fn dvsm_fixed_neon_queries;
dvsm_fixed_keys_fn dvsm_fixed_neon_keys;
dvsm_fixed_range_fn dvsm_fixed_neon_range;
dvsm_fixed_pack_fn dvsm_fixed_neon_pack_keys;
dvsm_fixed_pack_fn dvsm_fixed_neon_pack_values;

#endif
