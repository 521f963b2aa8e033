/* The x86-64 sets of fixed-point kernels, and the functions that they share. Private. */
#ifndef DVSM_KERNELS_FIXED_TIERS_H
#define DVSM_KERNELS_FIXED_TIERS_H

#include "kernels/fixed.h"

dvsm_fixed_gemm_fn dvsm_fixed_gemm_sse4;
dvsm_fixed_gemm_fn dvsm_fixed_gemm_avx2;
dvsm_fixed_gemm_fn dvsm_fixed_gemm_vnni;
dvsm_fixed_attention_fn dvsm_fixed_attention_sse4;
dvsm_fixed_attention_fn dvsm_fixed_attention_avx2;
dvsm_fixed_attention_fn dvsm_fixed_attention_vnni;

extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_sse4;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_avx2;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_avxvnni;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_avx512;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_vnni;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_amx;

#endif
