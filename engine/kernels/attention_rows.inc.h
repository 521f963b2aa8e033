/*
 * Template: sums of ATTENTION_ROWS keys (then: numbers of a value) by ATTENTION_VECTORS vectors of
 * queries, and the walk over a tile in such blocks. Included by the templates of attention that
 * hold them in registers.
 */

#include "kernels/attention_state.inc.h"

DVSM_INLINE void clear_rows(const int rows, vf sums[ATTENTION_ROWS][ATTENTION_VECTORS])
{
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			sums[i][j] = vf_set(0.0f);
	}
}

DVSM_INLINE void store_scores(const int rows, vf sums[ATTENTION_ROWS][ATTENTION_VECTORS],
			      float *scores)
{
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			vf_store(scores + i * QUERY_LANES + j * VF_LANES, sums[i][j]);
	}
}

/* out = out shrink + sums */
DVSM_INLINE void add_values(const int rows, vf sums[ATTENTION_ROWS][ATTENTION_VECTORS],
			    const struct attention_state *state, float *out)
{
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++) {
			float *o = out + i * QUERY_LANES + j * VF_LANES;
			vf shrink = vf_load(state->shrink + j * VF_LANES);

			vf_store(o, vf_fma(vf_load(o), shrink, sums[i][j]));
		}
	}
}

/* STEP(rows, at) for all of 0 .. total - 1, in blocks of a constant number of rows. */
#define FOR_ROWS(total, STEP)                                                                      \
	do {                                                                                       \
		size_t at = 0;                                                                     \
                                                                                                   \
		for (; at + ATTENTION_ROWS <= (total); at += ATTENTION_ROWS)                       \
			STEP(ATTENTION_ROWS, at);                                                  \
		if (at + 4 <= (total)) {                                                           \
			STEP(4, at);                                                               \
			at += 4;                                                                   \
		}                                                                                  \
		for (; at < (total); at++)                                                         \
			STEP(1, at);                                                               \
	} while (0)
