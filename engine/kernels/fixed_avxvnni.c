/*
 * The fixed-point set of AVX-VNNI: small x86 cores without AVX-512, and those that have both. What
 * it leaves out the AVX2 set does as well.
 */
#include "kernels/fixed_avx2_attention.inc.h"
#include "kernels/fixed_avx2_gemm.inc.h"
#include "kernels/fixed_tiers.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_avxvnni = {
	.cpu = DVSM_CPU_AVX_VNNI,
	.name = "avxvnni",
	.gemm = gemm,
	.attention = attention,
};
