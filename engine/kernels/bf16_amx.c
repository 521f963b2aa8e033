/* The bfloat16 kernels for AMX-BF16, with AVX-512 BF16 around them. */
#include "kernels/tier.h"
#include "kernels/vec_avx512bf16.h"

#include "kernels/amx.h"

#define GEMM_ROWS         1
#define GEMM_PANELS       1
#define ATTENTION_VECTORS 4
#define LEFT_TILED        true

/* Rows and columns of a tile of sums, and numbers of depth it takes in at a time. */
#define TILE  DVSM_TILE_ROWS
#define DEPTH DVSM_TILE_DEPTH

#include "kernels/math.inc.h"

#include "kernels/gelu_lookup.inc.h"

#define BF16_GELU gelu_lookup_vf
#include "kernels/number_bf16.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/gemm_finish.inc.h"

#include "kernels/amx_gemm.inc.h"
#include "kernels/amx_lay.inc.h"

#include "kernels/amx_online.inc.h"

#include "kernels/amx_bounded.inc.h"

static void attention_on_tiles(const struct dvsm_attention *job)
{
	const struct amx_config config = amx_whole_tiles();
	const bool whole = job->head_dim >= DEPTH && job->head_dim % DEPTH == 0;

	amx_open(&config);
	if (job->bound > 0 && job->bound <= DVSM_ATTENTION_BOUND && whole)
		attention_bounded(job);
	else
		attention(job);
	amx_close();
}

const struct dvsm_kernels dvsm_kernels_bf16_amx = {
	.cpu = DVSM_CPU_AMX_BF16,
	.name = "amx",
	.number_bytes = sizeof(number),
	.tiled = LEFT_TILED,
	.attention_queries = DVSM_ATTENTION_MOST_QUERIES,
	.product_rows = 256,
	.product_cols = 96,
	.gemm = gemm,
	.layer_norm = layer_norm,
	.embed_norm = embed_norm,
	.key_norm = key_norm,
	.query_norm = query_norm,
	.convert = convert,
	.left = left,
	.attention = attention_on_tiles,
	.lay = lay,
	.to_colour = to_colour,
};
