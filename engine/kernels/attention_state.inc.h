/* Template: what attention keeps of a group of queries. Included at the head of its template. */

#define QUERY_LANES (ATTENTION_VECTORS * VF_LANES)

/* What one group of QUERY_LANES queries keeps; all rows are QUERY_LANES wide. */
struct attention_state {
	float *q;      /* [head_dim] transposed, times scale and log2 e */
	float *out;    /* [head_dim] transposed, sum of weights times values */
	float *scores; /* [DVSM_ATTENTION_KEYS], then the weights */
	float *top;    /* largest score so far, base 2 */
	float *total;  /* sum of weights so far */
	float *shrink; /* what the last tile's new maximum did to the older sums */
	float *room;   /* [2 DVSM_ATTENTION_KEYS head_dim] for a tile of keys and one of values */
};

/* out[j][i] = in[i][j] for any rows x cols block. */
static void transpose(const float *in, size_t in_stride, size_t rows, size_t cols, float *out,
		      size_t out_stride)
{
	size_t i = 0;

	for (; i + 4 <= rows; i += 4) {
		const float *from = in + i * in_stride;
		size_t j = 0;

		for (; j + 4 <= cols; j += 4)
			vf_transpose4(from + j, in_stride, out + j * out_stride + i, out_stride);
		for (; j < cols; j++) {
			for (size_t r = 0; r < 4; r++)
				out[j * out_stride + i + r] = from[r * in_stride + j];
		}
	}
	for (; i < rows; i++) {
		for (size_t j = 0; j < cols; j++)
			out[j * out_stride + i] = in[i * in_stride + j];
	}
}
