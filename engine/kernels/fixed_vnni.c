/* The fixed-point set of AVX-512 VNNI; what it leaves out the AVX-512 set does as well. */
#include "kernels/fixed_tiers.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_vnni = {
	.cpu = DVSM_CPU_VNNI,
	.name = "vnni",
	.gemm = dvsm_fixed_gemm_vnni,
	.attention = dvsm_fixed_attention_vnni,
};
