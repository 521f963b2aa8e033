/* The products of the fixed-point set of AVX2. */
#include "kernels/fixed_avx2_attention.inc.h"
#include "kernels/fixed_avx2_gemm.inc.h"
#include "kernels/fixed_tiers.h"

void dvsm_fixed_gemm_avx2(const struct dvsm_fixed_gemm *job)
{
	gemm(job);
}

void dvsm_fixed_attention_avx2(const struct dvsm_fixed_attention *job)
{
	attention(job);
}
