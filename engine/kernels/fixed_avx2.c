/* The fixed-point set of AVX2; what it leaves out the scalar set does. */
#include "kernels/fixed_tiers.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_avx2 = {
	.cpu = DVSM_CPU_AVX2,
	.name = "avx2",
	.gemm = dvsm_fixed_gemm_avx2,
	.attention = dvsm_fixed_attention_avx2,
};
