/*
 * Keys and values of a head as AMX's attention reads them. Private to the engine.
 *
 * Numbers [keys][head_dim], head_dim a multiple of 32, lie *in blocks*: each 32 keys are a block of
 * as many numbers in another order, so that a block is whole tiles of a product's weights. Keys
 * behind the last whole block lie row by row.
 */
#ifndef DVSM_KERNELS_LAY_H
#define DVSM_KERNELS_LAY_H

#include <stdbool.h>
#include <stddef.h>

#include "kernels/bf16.h"

/** Keys of a block. */
#define DVSM_BLOCK_KEYS 32u

/** Which order: pairs of depth, [key / 16][d / 2][16 keys][2]; or of keys that are 16 apart,
 * [d / 16][16 keys][16 of d][2]. */
enum dvsm_block_order { DVSM_BLOCK_OF_KEYS, DVSM_BLOCK_OF_VALUES };

/** Where number [key][d] lies, key < keys. */
static inline size_t dvsm_block_place(enum dvsm_block_order order, size_t key, size_t d,
				      size_t keys, size_t head_dim)
{
	const size_t in = key % DVSM_BLOCK_KEYS, block = key - in;

	if (block + DVSM_BLOCK_KEYS > keys)
		return key * head_dim + d;
	if (order == DVSM_BLOCK_OF_KEYS)
		return (block + in / 16 * 16) * head_dim + d / 2 * 32 + in % 16 * 2 + d % 2;
	return block * head_dim + d / 16 * 512 + in % 16 * 32 + d % 16 * 2 + in / 16;
}

/** A head of rows to blocks, and back; any tier's order, because there is but one. */
void dvsm_lay_head(enum dvsm_block_order order, const dvsm_bf16 *rows, size_t keys, size_t head_dim,
		   dvsm_bf16 *blocks);
void dvsm_unlay_head(enum dvsm_block_order order, const dvsm_bf16 *blocks, size_t keys,
		     size_t head_dim, dvsm_bf16 *rows);

#endif
