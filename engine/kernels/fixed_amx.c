/*
 * Fixed-point products and attention for AMX-INT8, with AVX-512 VNNI around them.
 *
 * The packed layouts are tiles as they lie: sixteen rows of four numbers of sixteen columns. Two
 * tiles of A meet two of B in four tiles of sums, so that each tile loaded is used twice.
 */
#include "kernels/amx.h"
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

/* Rows and columns of a tile of sums, and bytes of depth it takes in at a time. */
#define TILE  16u
#define DEPTH 64u

#include "kernels/fixed_amx_attention.inc.h"
#include "kernels/fixed_amx_gemm.inc.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_amx = {
	.cpu = DVSM_CPU_AMX_INT8,
	.name = "amx",
	.gemm = gemm,
	.attention = attention,
	.attention_queries = DVSM_FIXED_MOST_QUERIES,
};
