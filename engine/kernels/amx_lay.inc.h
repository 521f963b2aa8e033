/*
 * Template: keys and values to blocks (lay.h) and back. Included by bf16_amx.c.
 */

/* out[j][i] = in[i][j] of 32-bit elements; rows of `out` are out_stride bytes apart. */
static void turn_block(__m512i in[TILE], unsigned char *out, size_t out_stride)
{
	__m512i a[TILE], b[TILE];

	for (size_t i = 0; i < TILE; i += 2) {
		a[i] = _mm512_unpacklo_epi32(in[i], in[i + 1]);
		a[i + 1] = _mm512_unpackhi_epi32(in[i], in[i + 1]);
	}
	for (size_t i = 0; i < TILE; i += 4) {
		b[i] = _mm512_unpacklo_epi64(a[i], a[i + 2]);
		b[i + 1] = _mm512_unpackhi_epi64(a[i], a[i + 2]);
		b[i + 2] = _mm512_unpacklo_epi64(a[i + 1], a[i + 3]);
		b[i + 3] = _mm512_unpackhi_epi64(a[i + 1], a[i + 3]);
	}
	/* b[4 r + c], quarter l, is column 4 l + c of rows 4 r and on. */
	for (size_t c = 0; c < 4; c++) {
		__m512i low = _mm512_shuffle_i32x4(b[c], b[c + 4], 0x88);
		__m512i high = _mm512_shuffle_i32x4(b[c], b[c + 4], 0xdd);
		__m512i low2 = _mm512_shuffle_i32x4(b[c + 8], b[c + 12], 0x88);
		__m512i high2 = _mm512_shuffle_i32x4(b[c + 8], b[c + 12], 0xdd);

		_mm512_storeu_si512(out + c * out_stride, _mm512_shuffle_i32x4(low, low2, 0x88));
		_mm512_storeu_si512(out + (c + 4) * out_stride,
				    _mm512_shuffle_i32x4(high, high2, 0x88));
		_mm512_storeu_si512(out + (c + 8) * out_stride,
				    _mm512_shuffle_i32x4(low, low2, 0xdd));
		_mm512_storeu_si512(out + (c + 12) * out_stride,
				    _mm512_shuffle_i32x4(high, high2, 0xdd));
	}
}

/* Sixteen numbers of a key's value, 0 where there are none. */
static inline __m512i value_lanes(const number *v, size_t keys, size_t head_dim, size_t key,
				  size_t d)
{
	const size_t left = key < keys && d < head_dim ? head_dim - d : 0;
	const __mmask16 lanes = left >= TILE ? 0xffff : (__mmask16)((1u << left) - 1);

	if (left == 0)
		return _mm512_setzero_si512();
	return _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(lanes, v + key * head_dim + d));
}

/* Keys to blocks, zeros up to `whole`. */
static void lay_keys(const number *k, size_t keys, size_t whole, size_t head_dim, number *to)
{
	for (size_t key = 0; key < whole; key += TILE) {
		for (size_t d = 0; d < head_dim; d += DEPTH) {
			__m512i rows[TILE];

			for (size_t i = 0; i < TILE; i++) {
				rows[i] = _mm512_setzero_si512();
				if (key + i < keys)
					rows[i] = _mm512_loadu_si512(k + (key + i) * head_dim + d);
			}
			turn_block(rows, (unsigned char *)(to + key * head_dim + d * TILE), 64);
		}
	}
}

/* Values to blocks, zeros up to `whole`. */
static void lay_values(const number *v, size_t keys, size_t whole, size_t head_dim, number *to)
{
	for (size_t key = 0; key < whole; key += DEPTH) {
		for (size_t d = 0; d < head_dim; d += TILE) {
			for (size_t i = 0; i < TILE; i++, to += 2 * TILE) {
				__m512i one = value_lanes(v, keys, head_dim, key + i, d);
				__m512i two = value_lanes(v, keys, head_dim, key + TILE + i, d);

				_mm512_storeu_si512(
					to, _mm512_or_si512(one, _mm512_slli_epi32(two, 16)));
			}
		}
	}
}

static void lay(const void *k, const void *v, size_t keys, size_t head_dim, void *to_k, void *to_v)
{
	lay_keys(k, keys, keys, head_dim, to_k);
	lay_values(v, keys, keys, head_dim, to_v);
}

/* Blocks to rows; a tile of keys is turned back as it was turned. */
static void unlay_keys(const number *k, size_t keys, size_t head_dim, number *rows)
{
	for (size_t key = 0; key < keys; key += TILE) {
		for (size_t d = 0; d < head_dim; d += DEPTH) {
			const number *from = k + key * head_dim + d * TILE;
			__m512i tile[TILE];

			for (size_t i = 0; i < TILE; i++)
				tile[i] = _mm512_loadu_si512(from + i * DEPTH);
			turn_block(tile, (unsigned char *)(rows + key * head_dim + d),
				   head_dim * sizeof(number));
		}
	}
}

static void unlay_values(const number *v, size_t keys, size_t head_dim, number *rows)
{
	for (size_t key = 0; key < keys; key += DEPTH) {
		for (size_t d = 0; d < head_dim; d += TILE) {
			for (size_t i = 0; i < TILE; i++, v += 2 * TILE) {
				__m512i pairs = _mm512_loadu_si512(v);
				number *to = rows + (key + i) * head_dim + d;

				_mm256_storeu_si256((__m256i *)to, _mm512_cvtepi32_epi16(pairs));
				pairs = _mm512_srli_epi32(pairs, 16);
				to += TILE * head_dim;
				_mm256_storeu_si256((__m256i *)to, _mm512_cvtepi32_epi16(pairs));
			}
		}
	}
}
