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

#include "kernels/fixed_amx_gemm.inc.h"

/* ---- attention ---- */

/* Rows that are not there are 0; the others are `rows` from `a` on. */
struct fringe {
	_Alignas(64) int8_t rows[TILE][DEPTH];
};

#define QUERIES 16

#include "kernels/fixed_avx512_softmax.inc.h"

/* Tiles 4 and 5 are whole, 6 and 7 what is left of the head behind whole ones. */
static struct amx_config score_tiles(size_t head_width)
{
	struct amx_config config = amx_whole_tiles();
	const size_t rest = head_width % DEPTH;

	if (rest > 0) {
		config.row_bytes[6] = (uint16_t)rest;
		config.rows[7] = (uint8_t)(rest / 4);
	}
	return config;
}

/* Where the head has no rest, both products have the tiles that attention opened. */
static void reshape(size_t head_width, const struct amx_config *config)
{
	if (head_width % DEPTH > 0)
		amx_open(config);
}

/* Queries' bytes d and on to whole rows of a tile, once a tile of keys. */
static void gather_queries(const struct query *queries, size_t d, size_t bytes, struct fringe *rows)
{
	for (int i = 0; i < QUERIES; i++)
		memcpy(rows->rows[i], queries[i].q + d, bytes);
}

/* Sums 0 to 3 += queries times `groups` groups of keys, for one slice of the head. */
static void score_slice(const struct fringe *rows, const int8_t *k, size_t group_bytes,
			size_t groups, bool whole)
{
	if (whole)
		AMX_LOAD(4, rows->rows, DEPTH);
	else
		AMX_LOAD(6, rows->rows, DEPTH);

#define GROUP(n)                                                                                   \
	do {                                                                                       \
		if (groups <= (n))                                                                 \
			return;                                                                    \
		if (whole) {                                                                       \
			AMX_LOAD(5, k + (n)*group_bytes, 64);                                      \
			AMX_DOT_SIGNED(n, 4, 5);                                                   \
		} else {                                                                           \
			AMX_LOAD(7, k + (n)*group_bytes, 64);                                      \
			AMX_DOT_SIGNED(n, 6, 7);                                                   \
		}                                                                                  \
	} while (0)

	GROUP(0);
	GROUP(1);
	GROUP(2);
	GROUP(3);
#undef GROUP
}

static void score(const struct query *queries, const int8_t *k, size_t head_width, size_t count)
{
	const struct amx_config config = score_tiles(head_width);
	const size_t stride =
		(size_t)((unsigned char *)queries[1].scores - (unsigned char *)queries[0].scores);
	const size_t group_bytes = TILE * head_width;
	struct fringe rows = {{{0}}};

	reshape(head_width, &config);
	for (size_t key = 0; key < count; key += 4 * TILE) {
		const size_t groups = (count - key + TILE - 1) / TILE;
		int32_t *scores = queries[0].scores + key;

		AMX_ZERO(0);
		AMX_ZERO(1);
		AMX_ZERO(2);
		AMX_ZERO(3);
		for (size_t d = 0; d < head_width; d += DEPTH) {
			const size_t bytes = head_width - d < DEPTH ? head_width - d : DEPTH;

			gather_queries(queries, d, bytes, &rows);
			score_slice(&rows, k + key * head_width + d * TILE, group_bytes, groups,
				    bytes == DEPTH);
		}
		AMX_STORE(0, scores, stride);
		AMX_STORE(1, scores + TILE, stride);
		AMX_STORE(2, scores + 2 * TILE, stride);
		AMX_STORE(3, scores + 3 * TILE, stride);
	}
}

/* o += high + R(low, 8) of sixteen channels. */
static void add_planes(const struct query *queries, size_t channel, int32_t high[TILE][TILE],
		       int32_t low[TILE][TILE])
{
	const __m512i half = _mm512_set1_epi32(128);

	for (int i = 0; i < QUERIES; i++) {
		int32_t *o = queries[i].o + channel;
		__m512i rest = _mm512_add_epi32(_mm512_load_si512(low[i]), half);
		__m512i sum =
			_mm512_add_epi32(_mm512_load_si512(high[i]), _mm512_srai_epi32(rest, 8));

		_mm512_store_si512(o, _mm512_add_epi32(_mm512_load_si512(o), sum));
	}
}

/* Both planes of the weights times two groups of channels at a time. */
struct sums {
	_Alignas(64) int32_t part[2][2][TILE][TILE];
};

static void mix(const struct query *queries, const int8_t *v, size_t head_width, size_t count)
{
	const struct amx_config config = amx_whole_tiles();
	const size_t stride = (size_t)(queries[1].high - queries[0].high);
	const uint8_t *high = queries[0].high, *low = queries[0].low;
	struct sums sums;

	reshape(head_width, &config);
	for (size_t channel = 0; channel < head_width; channel += 2 * TILE) {
		const bool two = channel + TILE < head_width;

		AMX_ZERO(0);
		AMX_ZERO(1);
		AMX_ZERO(2);
		AMX_ZERO(3);
		for (size_t key = 0; key < count; key += DEPTH) {
			const int8_t *from = v + key * head_width + 4 * channel;

			AMX_LOAD(4, high + key, stride);
			AMX_LOAD(5, low + key, stride);
			AMX_LOAD(6, from, 4 * head_width);
			AMX_DOT_UNSIGNED(0, 4, 6);
			AMX_DOT_UNSIGNED(1, 5, 6);
			if (two) {
				AMX_LOAD(7, from + 64, 4 * head_width);
				AMX_DOT_UNSIGNED(2, 4, 7);
				AMX_DOT_UNSIGNED(3, 5, 7);
			}
		}
		AMX_STORE(0, sums.part[0][0], 64);
		AMX_STORE(1, sums.part[0][1], 64);
		add_planes(queries, channel, sums.part[0][0], sums.part[0][1]);
		if (two) {
			AMX_STORE(2, sums.part[1][0], 64);
			AMX_STORE(3, sums.part[1][1], 64);
			add_planes(queries, channel + TILE, sums.part[1][0], sums.part[1][1]);
		}
	}
}

#include "kernels/fixed_avx512_attend.inc.h"

static void attention_on_tiles(const struct dvsm_fixed_attention *job)
{
	const struct amx_config config = amx_whole_tiles();

	amx_open(&config);
	attention(job);
	amx_close();
}

const struct dvsm_fixed_kernels dvsm_fixed_kernels_amx = {
	.cpu = DVSM_CPU_AMX_INT8,
	.name = "amx",
	.gemm = gemm,
	.attention = attention_on_tiles,
};
