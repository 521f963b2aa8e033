#include "kernels/lay.h"

void dvsm_lay_head(enum dvsm_block_order order, const dvsm_bf16 *rows, size_t keys, size_t head_dim,
		   dvsm_bf16 *blocks)
{
	for (size_t key = 0; key < keys; key++) {
		for (size_t d = 0; d < head_dim; d++)
			blocks[dvsm_block_place(order, key, d, keys, head_dim)] =
				rows[key * head_dim + d];
	}
}

void dvsm_unlay_head(enum dvsm_block_order order, const dvsm_bf16 *blocks, size_t keys,
		     size_t head_dim, dvsm_bf16 *rows)
{
	for (size_t key = 0; key < keys; key++) {
		for (size_t d = 0; d < head_dim; d++)
			rows[key * head_dim + d] =
				blocks[dvsm_block_place(order, key, d, keys, head_dim)];
	}
}
