/*
 * The steps of the transformer as jobs of the thread pool. Each cuts its work into tiles whose size
 * depends on the shapes alone. Private to the engine.
 */
#ifndef DVSM_FORWARD_STEPS_H
#define DVSM_FORWARD_STEPS_H

#include "fixed/trace.h"
#include "forward/workspace.h"
#include "kernels/kernels.h"
#include "model/model.h"
#include "threads/pool.h"

/** Everything a step needs; borrowed for one reconstruction or rendering. */
struct dvsm_run {
	const struct dvsm_model *model;
	const struct dvsm_weights *weights; /* as the kernels read them */
	const struct dvsm_kernels *kernels;
	struct dvsm_pool *pool;
	struct dvsm_trace *trace; /* NULL, or notes what the blocks compute */
	bool deblock;             /* rendered pictures */
	struct dvsm_workspace work;
};

/**
 * Keys and values of one layer, numbers [heads][total][head_dim] each, of which a step may fill a
 * part; each head in blocks (kernels/lay.h) where the kernels want them.
 */
struct dvsm_heads {
	void *keys, *values;
	size_t total; /* tokens */
};

/** x[rows][D] = LN(x), in place. */
void dvsm_step_embed_norm(const struct dvsm_run *run, float *x, size_t rows, const float *weight);

/** out[rows][D], left side, = LN(x[rows][D]). */
void dvsm_step_norm(const struct dvsm_run *run, const float *x, size_t rows, const float *weight,
		    void *out);

/** out[rows][width], left side, = x[rows][width]; out may be x where numbers are floats. */
void dvsm_step_convert(const struct dvsm_run *run, const float *x, size_t rows, size_t width,
		       void *out);

/**
 * C[rows] = epilogue(A[rows] W^T); A is a left side [rows][W.in], C floats, rows c_stride of them
 * apart, or, as the epilogue says, a left side.
 */
void dvsm_step_product(const struct dvsm_run *run, const void *a, size_t rows,
		       const struct dvsm_matrix *w, void *c, size_t c_stride,
		       enum dvsm_epilogue epilogue);

/** The same by the calling thread alone. */
void dvsm_rows_product(const struct dvsm_run *run, const void *a, size_t rows,
		       const struct dvsm_matrix *w, void *c, size_t c_stride,
		       enum dvsm_epilogue epilogue);

/** The scratch of one thread: work.scratch_stride bytes. */
static inline void *dvsm_run_scratch(const struct dvsm_run *run, uint32_t worker)
{
	return run->work.scratch + worker * run->work.scratch_stride;
}

/** The place of number `index` of an array of numbers, to write and to read. */
static inline void *dvsm_run_number(const struct dvsm_run *run, void *numbers, size_t index)
{
	return (unsigned char *)numbers + index * run->kernels->number_bytes;
}

/** The place of [row][col] of a left side: row a multiple of 16, col of 32. */
static inline void *dvsm_run_left(const struct dvsm_run *run, void *left, size_t row, size_t col,
				  size_t stride)
{
	return dvsm_run_number(run, left, dvsm_left_place(run->kernels, row, col, stride));
}

static inline const void *dvsm_run_read(const struct dvsm_run *run, const void *numbers,
					size_t index)
{
	return (const unsigned char *)numbers + index * run->kernels->number_bytes;
}

#endif
