/* The specification of the fixed-point kernels, in plain C. */
#include "kernels/fixed_rows.inc.h"

/* ---- products ---- */

static void store(const struct dvsm_fixed_gemm *job, size_t row, size_t col, int32_t sum)
{
	const struct dvsm_fixed_scale scale = job->a_scale[row];
	int shift = dvsm_fixed_clamp(job->w_shift[col] - scale.exponent, 1, 62);
	int64_t factor = dvsm_fixed_mulhrs(scale.mantissa, job->w_mantissa[col]);
	int64_t r = dvsm_fixed_round(sum * factor * (1 << 15), shift);
	size_t at = row * job->c_stride + col;

	switch (job->epilogue) {
	case DVSM_FIXED_ADD: {
		int32_t *c = (int32_t *)job->c + at;

		*c = (int32_t)((uint32_t)*c + (uint32_t)r);
		break;
	}
	case DVSM_FIXED_STORE:
		((int16_t *)job->c)[at] = dvsm_fixed_saturate(r);
		break;
	case DVSM_FIXED_GELU:
		((int16_t *)job->c)[at] = dvsm_fixed_gelu(dvsm_fixed_saturate(r), job->fraction);
		break;
	}
}

/* Rows that meet a panel together, and the depth that is widened for them at a time. */
#define ROWS  32u
#define DEPTH 512u

/* `count` numbers of each column of a panel. */
static void widen_panel(const int8_t *panel, size_t count, int16_t columns[DVSM_FIXED_PANEL][DEPTH])
{
	for (size_t d = 0; d < count; d++)
		for (size_t j = 0; j < DVSM_FIXED_PANEL; j++)
			columns[j][d] = panel[d / 4 * 4 * DVSM_FIXED_PANEL + 4 * j + d % 4];
}

/* sums += products of words with four columns: what compilers make vectors of. */
static void dot(const int16_t *a, int16_t columns[4][DEPTH], size_t count, int32_t sums[4])
{
	int32_t first = 0, second = 0, third = 0, fourth = 0;

	for (size_t d = 0; d < count; d++) {
		first += a[d] * columns[0][d];
		second += a[d] * columns[1][d];
		third += a[d] * columns[2][d];
		fourth += a[d] * columns[3][d];
	}
	sums[0] += first;
	sums[1] += second;
	sums[2] += third;
	sums[3] += fourth;
}

/* sums += up to ROWS rows, from `row` on, times a piece of a panel, from depth `first` on. */
static void add_piece(const struct dvsm_fixed_gemm *job, size_t row, size_t rows,
		      const int8_t *panel, size_t first, int32_t sums[ROWS][DVSM_FIXED_PANEL])
{
	const size_t left = job->depth - first, count = left < DEPTH ? left : DEPTH;
	int16_t columns[DVSM_FIXED_PANEL][DEPTH], numbers[DEPTH];

	widen_panel(panel + first * DVSM_FIXED_PANEL, count, columns);
	for (size_t i = 0; i < rows; i++) {
		const int8_t *a = job->a + (row + i) * job->a_stride + first;

		for (size_t d = 0; d < count; d++)
			numbers[d] = a[d];
		for (size_t j = 0; j < DVSM_FIXED_PANEL; j += 4)
			dot(numbers, columns + j, count, sums[i] + j);
	}
}

static void gemm(const struct dvsm_fixed_gemm *job)
{
	for (size_t first = 0; first < job->cols; first += DVSM_FIXED_PANEL) {
		const int8_t *panel = job->panels + first * job->depth;
		const size_t left = job->cols - first;
		const size_t width = left < DVSM_FIXED_PANEL ? left : DVSM_FIXED_PANEL;

		for (size_t row = 0; row < job->rows; row += ROWS) {
			const size_t rows = job->rows - row < ROWS ? job->rows - row : ROWS;
			int32_t sums[ROWS][DVSM_FIXED_PANEL] = {{0}};

			for (size_t d = 0; d < job->depth; d += DEPTH)
				add_piece(job, row, rows, panel, d, sums);
			for (size_t i = 0; i < rows; i++)
				for (size_t j = 0; j < width; j++)
					store(job, row + i, first + j, sums[i][j]);
		}
	}
}

/* ---- attention ---- */

/*
 * Sums of a query with 16 keys, key_width a multiple of 8. Products of two fit 16 bits: -128 ..
 * 127 times -127 .. 127. In loops of eight, which compilers turn into vectors.
 */
static void sum_keys(const int8_t *q, const int8_t *keys, size_t key_width,
		     int32_t sums[DVSM_FIXED_PANEL])
{
	int32_t parts[8][8] = {{0}};

	for (size_t d = 0; d < key_width; d += 8, keys += 8 * (size_t)DVSM_FIXED_PANEL) {
		int16_t first[8], second[8];

		for (size_t k = 0; k < 8; k++) {
			first[k] = q[d + k % 4];
			second[k] = q[d + 4 + k % 4];
		}
		for (size_t i = 0; i < 8; i++) {
			for (size_t k = 0; k < 8; k++)
				parts[i][k] += (int16_t)(first[k] * keys[8 * i + k] +
							 second[k] * keys[64 + 8 * i + k]);
		}
	}
	for (size_t j = 0; j < DVSM_FIXED_PANEL; j++) {
		const int32_t *four = parts[j / 2] + j % 2 * 4;

		sums[j] = four[0] + four[1] + four[2] + four[3];
	}
}

/* Scores of a tile's keys; the last group of 16 may reach into the padding. Returns the largest. */
static int16_t score(const struct dvsm_fixed_attention *job, const int8_t *q, size_t first,
		     size_t count, int shift, int16_t *scores)
{
	int16_t largest = INT16_MIN;

	for (size_t key = 0; key < count; key += DVSM_FIXED_PANEL) {
		int32_t sums[DVSM_FIXED_PANEL];

		sum_keys(q, job->k + (first + key) * job->key_width, job->key_width, sums);
		for (size_t i = 0; i < DVSM_FIXED_PANEL; i++)
			scores[key + i] = (int16_t)(sums[i] >> shift);
	}
	for (size_t key = 0; key < count; key++)
		largest = scores[key] > largest ? scores[key] : largest;
	return largest;
}

static uint16_t weight(struct dvsm_fixed_slope slope, int16_t top, int16_t s)
{
	return dvsm_fixed_exp2((uint32_t)(top - s) * slope.factor >> 16, slope.fraction);
}

/* O += the tile's weighted values; p is [tile], v the tile's values, parts [head_width][4]. */
static void mix(const int16_t *p, const int8_t *v, size_t count, size_t dim, size_t head_width,
		int32_t *parts, int64_t *o)
{
	memset(parts, 0, 4 * head_width * sizeof(*parts));
	for (size_t key = 0; key < count; key += 4, v += 4 * head_width) {
		int16_t four[8];

		for (size_t k = 0; k < 8; k++)
			four[k] = key + k % 4 < count ? p[key + k % 4] : 0;
		for (size_t at = 0; at < 4 * head_width; at += 8) {
			for (size_t k = 0; k < 8; k++)
				parts[at + k] += four[k] * v[at + k];
		}
	}
	for (size_t d = 0; d < dim; d++)
		o[d] += parts[4 * d] + parts[4 * d + 1] + parts[4 * d + 2] + parts[4 * d + 3];
}

static void attend(const struct dvsm_fixed_attention *job, const int8_t *q,
		   struct dvsm_fixed_scale scale, int16_t *scores, int64_t *o, int16_t *out)
{
	const bool kept = job->keys <= DVSM_FIXED_SCORES;
	const int word_shift = dvsm_fixed_score_shift(q, job->key_width);
	struct dvsm_fixed_slope slope = dvsm_fixed_slope_make(scale, word_shift);
	int32_t *parts = (int32_t *)(void *)(o + job->head_width);
	int16_t top = INT16_MIN, p[DVSM_FIXED_KEYS];
	int64_t sum = 0;

	for (size_t first = 0; first < job->keys; first += DVSM_FIXED_KEYS) {
		int16_t largest = score(job, q, first, dvsm_fixed_tile_keys(job, first), word_shift,
					kept ? scores + first : scores);

		top = largest > top ? largest : top;
	}
	memset(o, 0, job->dim * sizeof(*o));
	for (size_t first = 0; first < job->keys; first += DVSM_FIXED_KEYS) {
		const size_t count = dvsm_fixed_tile_keys(job, first);
		const int16_t *tile = kept ? scores + first : scores;

		if (!kept)
			score(job, q, first, count, word_shift, scores);
		for (size_t key = 0; key < count; key++) {
			p[key] = (int16_t)weight(slope, top, tile[key]);
			sum += p[key];
		}
		mix(p, job->v + first * job->head_width, count, job->dim, job->head_width, parts,
		    o);
	}

	struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)sum);

	for (size_t d = 0; d < job->dim; d++) {
		int shift = dvsm_fixed_clamp(DVSM_FIXED_QUOTIENT_BITS - job->v_scale[d].exponent, 1,
					     62);
		int64_t product = (int64_t)dvsm_fixed_lift(o[d], quotient) *
				  (quotient.inverse * job->v_scale[d].mantissa);

		out[d] = dvsm_fixed_saturate(job->v_mean[d] + dvsm_fixed_round(product, shift));
	}
}

static void attention(const struct dvsm_fixed_attention *job)
{
	int16_t *scores = job->scratch;
	int64_t *o = (int64_t *)(void *)(scores + DVSM_FIXED_SCORES);

	for (size_t i = 0; i < job->queries; i++)
		attend(job, job->q + i * job->q_stride, job->q_scale[i * job->scale_stride], scores,
		       o, job->out + i * job->out_stride);
}

const struct dvsm_fixed_kernels dvsm_fixed_kernels_scalar = {
	.cpu = DVSM_CPU_SCALAR,
	.name = "scalar",
	.gemm = gemm,
	.norm = norm,
	.quantise = quantise,
	.split = split,
	.queries = queries,
	.keys = keys,
	.range = range,
	.pack_keys = pack_keys,
	.pack_values = pack_values,
	.attention = attention,
	.attention_queries = DVSM_FIXED_QUERIES,
};
