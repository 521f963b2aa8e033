/*
 * Template: matrix product with packed weights. Included once by each f32_<tier>.c, after
 * f32_math.inc.h and after
 *
 *   GEMM_ROWS     rows of A that a full tile takes
 *   GEMM_PANELS   weight panels that a full tile takes
 *
 * A tile keeps GEMM_ROWS x GEMM_PANELS x 16 sums in registers while it walks the depth: per step it
 * loads the weights once and one number of each row of A. Each sum is one chain of
 * multiply-adds over the depth, whichever tile shape computes it.
 */

#define PANEL_VECTORS (DVSM_PANEL / VF_LANES)

static inline void finish_part(float *c, vf sum, size_t lanes, enum dvsm_epilogue epilogue)
{
	if (epilogue == DVSM_EPILOGUE_ADD)
		sum = vf_add(vf_load_part(c, lanes), sum);
	else if (epilogue == DVSM_EPILOGUE_GELU)
		sum = gelu_vf(sum);
	vf_store_part(c, sum, lanes);
}

static inline void finish(float *c, vf sum, enum dvsm_epilogue epilogue)
{
	if (epilogue == DVSM_EPILOGUE_ADD)
		sum = vf_add(vf_load(c), sum);
	else if (epilogue == DVSM_EPILOGUE_GELU)
		sum = gelu_vf(sum);
	vf_store(c, sum);
}

/* One tile; `rows` and `panels` are constants where it is called. `cols` may cut the last panel. */
DVSM_INLINE void gemm_tile(const int rows, const int panels, const float *a, size_t a_stride,
			   const float *w, size_t depth, size_t cols, float *c, size_t c_stride,
			   enum dvsm_epilogue epilogue)
{
	const int vectors = panels * PANEL_VECTORS;
	vf sums[GEMM_ROWS][GEMM_PANELS * PANEL_VECTORS];

	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < vectors; j++)
			sums[i][j] = vf_set(0.0f);
	}
	for (size_t d = 0; d < depth; d++) {
		vf b[GEMM_PANELS * PANEL_VECTORS];

		DVSM_UNROLL
		for (int j = 0; j < vectors; j++) {
			size_t panel = (size_t)(j / PANEL_VECTORS), part = j % PANEL_VECTORS;

			b[j] = vf_load(w + (panel * depth + d) * DVSM_PANEL + part * VF_LANES);
		}
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			vf x = vf_set(a[(size_t)i * a_stride + d]);

			DVSM_UNROLL
			for (int j = 0; j < vectors; j++)
				sums[i][j] = vf_fma(x, b[j], sums[i][j]);
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < vectors; j++) {
			float *out = c + (size_t)i * c_stride + (size_t)j * VF_LANES;
			size_t left = cols - (size_t)j * VF_LANES;

			if ((size_t)j * VF_LANES >= cols)
				continue;
			if (left >= VF_LANES)
				finish(out, sums[i][j], epilogue);
			else
				finish_part(out, sums[i][j], left, epilogue);
		}
	}
}

/* All rows against `panels` panels: full tiles, then ever smaller ones. */
DVSM_INLINE void gemm_columns(const int panels, const float *a, size_t a_stride, size_t rows,
			      const float *w, size_t depth, size_t cols, float *c, size_t c_stride,
			      enum dvsm_epilogue epilogue)
{
#define TILE(count)                                                                                \
	do {                                                                                       \
		gemm_tile(count, panels, a, a_stride, w, depth, cols, c, c_stride, epilogue);      \
		a += (count)*a_stride;                                                             \
		c += (count)*c_stride;                                                             \
		rows -= (count);                                                                   \
	} while (0)

	while (rows >= GEMM_ROWS)
		TILE(GEMM_ROWS);
	if (GEMM_ROWS > 4 && rows >= 4)
		TILE(4);
	if (GEMM_ROWS > 2 && rows >= 2)
		TILE(2);
	if (rows >= 1)
		TILE(1);
#undef TILE
}

static void gemm(const float *a, size_t a_stride, size_t rows, const float *panels, size_t depth,
		 size_t cols, float *c, size_t c_stride, enum dvsm_epilogue epilogue)
{
	while (cols > 0) {
		const size_t full = GEMM_PANELS * DVSM_PANEL;
		size_t width = cols < full ? cols : full;

		if (width > (GEMM_PANELS - 1) * DVSM_PANEL) {
			gemm_columns(GEMM_PANELS, a, a_stride, rows, panels, depth, width, c,
				     c_stride, epilogue);
		} else {
			width = width < DVSM_PANEL ? width : DVSM_PANEL;
			gemm_columns(1, a, a_stride, rows, panels, depth, width, c, c_stride,
				     epilogue);
		}
		panels += (width + DVSM_PANEL - 1) / DVSM_PANEL * DVSM_PANEL * depth;
		c += width;
		cols -= width;
	}
}
