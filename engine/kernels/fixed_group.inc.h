/*
 * Template: fixed-point attention of QUERIES queries that pass over the keys together, twice: for
 * the largest score, then for the sums. Included by a tier behind
 *
 *   struct query         a query on its way: top; scores, weights, o and o_low, which place() lays;
 *                        and what else the tier's steps need
 *   start()              its state before the first key
 *   score()              scores of a tile of keys, `at` behind where the query's begin
 *   largest_score()      of a tile's
 *   weigh(), mix()       a tile's weights, and their sum; sums of weights times values
 *   write_out()          what comes of them
 */

/* Up to here the sums of weighted values fit 32 bits. */
#define MOST_KEYS 65536u

/* Whether all scores are kept between the passes, or those of a tile alone. */
static inline bool scores_kept(const struct dvsm_fixed_attention *job)
{
	return dvsm_fixed_scores_fit(QUERIES, job->keys);
}

static inline size_t scores_stride(const struct dvsm_fixed_attention *job)
{
	return dvsm_fixed_scores_stride(scores_kept(job) ? job->keys : DVSM_FIXED_KEYS);
}

/* Places in the caller's scratch, a query: scores, 16 bits a weight of a tile, two sums a channel,
 * two bytes a number of the query. */
static void place(const struct dvsm_fixed_attention *job, struct query queries[QUERIES])
{
	int16_t *scores = job->scratch;
	unsigned char *at = (unsigned char *)(scores + DVSM_FIXED_SCORES);

	for (size_t i = 0; i < QUERIES; i++) {
		queries[i].scores = scores + i * scores_stride(job);
		queries[i].weights = (void *)at;
		at += DVSM_FIXED_KEYS * sizeof(int16_t);
		queries[i].o = (int32_t *)(void *)at;
		queries[i].o_low = queries[i].o + job->head_width;
		at += 2 * job->head_width * sizeof(int32_t) +
		      dvsm_fixed_pad(2 * job->key_width, 64);
	}
}

static void find_tops(const struct dvsm_fixed_attention *job, struct query queries[QUERIES])
{
	const bool kept = scores_kept(job);

	for (size_t key = 0; key < job->keys; key += DVSM_FIXED_KEYS) {
		const size_t count = dvsm_fixed_tile_keys(job, key), at = kept ? key : 0;

		score(queries, job->k + key * job->key_width, job->key_width, count, at);
		for (size_t i = 0; i < QUERIES; i++) {
			int16_t largest = largest_score(&queries[i], count, at);

			if (largest > queries[i].top)
				queries[i].top = largest;
		}
	}
}

/* Queries `first` and on; a group that is not full repeats the last one. */
static void attend(const struct dvsm_fixed_attention *job, struct query queries[QUERIES],
		   size_t first, size_t count)
{
	const size_t width = job->head_width;
	const bool kept = scores_kept(job);

	for (size_t i = 0; i < QUERIES; i++)
		start(job, first + (i < count ? i : count - 1), &queries[i]);
	find_tops(job, queries);
	for (size_t key = 0; key < job->keys; key += DVSM_FIXED_KEYS) {
		const size_t keys = dvsm_fixed_tile_keys(job, key), at = kept ? key : 0;

		if (!kept)
			score(queries, job->k + key * job->key_width, job->key_width, keys, at);
		for (size_t i = 0; i < QUERIES; i++)
			weigh(&queries[i], keys, at);
		mix(queries, job->v + key * width, width, keys);
	}
	for (size_t i = 0; i < count; i++)
		write_out(job, &queries[i], job->out + (first + i) * job->out_stride);
}

static void attention(const struct dvsm_fixed_attention *job)
{
	struct query queries[QUERIES];

	if (job->keys > MOST_KEYS) {
		dvsm_fixed_kernels_scalar.attention(job);
		return;
	}
	place(job, queries);
	for (size_t first = 0; first < job->queries; first += QUERIES) {
		size_t left = job->queries - first;

		attend(job, queries, first, left < QUERIES ? left : QUERIES);
	}
}
