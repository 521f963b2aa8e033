/*
 * Template: a whole product as tiles. Included after a template that defines gemm_tile() for up to
 * GEMM_ROWS rows and GEMM_PANELS panels.
 */

/* All rows against `panels` panels: full tiles, then ever smaller ones. */
DVSM_INLINE void gemm_columns(const int panels, const number *a, size_t a_stride, size_t rows,
			      const number *w, size_t depth, size_t cols, void *c, size_t at,
			      size_t c_stride, enum dvsm_epilogue epilogue)
{
#define TILE(count)                                                                                \
	do {                                                                                       \
		gemm_tile(count, panels, a, a_stride, w, depth, cols, c, at, c_stride, epilogue);  \
		a += (count)*a_stride;                                                             \
		at += (count)*c_stride;                                                            \
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

static void gemm(const void *a, size_t a_stride, size_t rows, const void *panels, size_t depth,
		 size_t cols, void *c, size_t c_stride, enum dvsm_epilogue epilogue)
{
	const number *w = panels;
	size_t at = 0;

	while (cols > 0) {
		const size_t full = GEMM_PANELS * DVSM_PANEL;
		size_t width = cols < full ? cols : full;

		if (width > (GEMM_PANELS - 1) * DVSM_PANEL) {
			gemm_columns(GEMM_PANELS, a, a_stride, rows, w, depth, width, c, at,
				     c_stride, epilogue);
		} else {
			width = width < DVSM_PANEL ? width : DVSM_PANEL;
			gemm_columns(1, a, a_stride, rows, w, depth, width, c, at, c_stride,
				     epilogue);
		}
		w += (width + DVSM_PANEL - 1) / DVSM_PANEL * DVSM_PANEL * PANEL_DEPTH(depth);
		at += width;
		cols -= width;
	}
}
