/* Template: the two ends of a product's tile. Included at the head of a gemm template. */

#define PANEL_VECTORS ((int)(DVSM_PANEL / VF_LANES))
#define TILE_VECTORS  (GEMM_PANELS * PANEL_VECTORS)

DVSM_INLINE void clear_tile(const int rows, const int vectors, vf sums[GEMM_ROWS][TILE_VECTORS])
{
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < vectors; j++)
			sums[i][j] = vf_set(0.0f);
	}
}

/* Lanes `at` and on of c; `left` of them exist. */
static inline void finish(void *c, size_t at, size_t left, vf sum, enum dvsm_epilogue epilogue)
{
	const bool whole = left >= VF_LANES;
	float *floats = (float *)c + at;

	if (epilogue == DVSM_EPILOGUE_GELU) {
		number *numbers = (number *)c + at;

		if (whole)
			num_store(numbers, num_gelu(sum));
		else
			num_store_part(numbers, num_gelu(sum), left);
		return;
	}
	if (epilogue == DVSM_EPILOGUE_ADD)
		sum = vf_add(whole ? vf_load(floats) : vf_load_part(floats, left), sum);
	if (whole)
		vf_store(floats, sum);
	else
		vf_store_part(floats, sum, left);
}

DVSM_INLINE void finish_tile(const int rows, const int vectors, vf sums[GEMM_ROWS][TILE_VECTORS],
			     size_t cols, void *c, size_t at, size_t c_stride,
			     enum dvsm_epilogue epilogue)
{
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < vectors; j++) {
			size_t col = (size_t)j * VF_LANES;

			if (col < cols)
				finish(c, at + (size_t)i * c_stride + col, cols - col, sums[i][j],
				       epilogue);
		}
	}
}
