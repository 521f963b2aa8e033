/*
 * Template: fixed-point attention of QUERIES queries that pass over the keys together. Included by
 * a tier behind
 *
 *   struct query         a query on its way: scale, top and what the tier's steps need
 *   place(), start()     its places in the caller's scratch; its state before the first key
 *   score(), mix()       scores of a tile of keys; o += weights times values
 *   largest_score(), shrink(), weigh(), write_out()
 */

/* Up to here the sums of weighted values fit 32 bits, and the sum of weights needs no shift. */
#define MOST_KEYS 65536u

/* The running maximum, then the weights of a tile. */
static void softmax(struct query *query, size_t head_width, bool first, size_t count)
{
	int32_t largest = largest_score(query, count);

	if (first)
		query->top = largest;
	else if (largest > query->top)
		shrink(query, head_width, dvsm_fixed_raise(query->scale, largest, &query->top));
	weigh(query, count);
}

/* Queries `first` and on; a group that is not full repeats the last one. */
static void attend(const struct dvsm_fixed_attention *job, struct query queries[QUERIES],
		   size_t first, size_t count)
{
	const size_t width = job->head_width;

	for (size_t i = 0; i < QUERIES; i++)
		start(job, first + (i < count ? i : count - 1), &queries[i]);
	for (size_t key = 0; key < job->keys; key += DVSM_FIXED_KEYS) {
		size_t left = job->keys - key;
		size_t keys = left < DVSM_FIXED_KEYS ? left : DVSM_FIXED_KEYS;

		score(queries, job->k + key * width, width, keys);
		for (size_t i = 0; i < QUERIES; i++)
			softmax(&queries[i], width, key == 0, keys);
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
