/* The fixed-point kernels of rows as the compiler's vectors of AVX2 do them. */
#include "kernels/fixed_rows.inc.h"
#include "kernels/fixed_tiers.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_avx2 = {
	.cpu = DVSM_CPU_AVX2,
	.name = "avx2",
	.gemm = dvsm_fixed_gemm_avx2,
	.norm = norm,
	.quantise = quantise,
	.split = split,
	.queries = queries,
	.keys = keys,
	.range = range,
	.pack_keys = pack_keys,
	.pack_values = pack_values,
	.attention = dvsm_fixed_attention_avx2,
};
