/* The fixed-point kernels of rows as the compiler's vectors of SSE4.1 do them. */
#include "kernels/fixed_rows.inc.h"
#include "kernels/fixed_tiers.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_sse4 = {
	.cpu = DVSM_CPU_SSE4,
	.name = "sse4",
	.gemm = dvsm_fixed_gemm_sse4,
	.norm = norm,
	.quantise = quantise,
	.split = split,
	.queries = queries,
	.keys = keys,
	.range = range,
	.pack_keys = pack_keys,
	.pack_values = pack_values,
	.attention = dvsm_fixed_attention_sse4,
};
