#include "forward/steps.h"

/* Tokens a task takes where the work on each is small. */
#define ROWS_PER_TASK 32u

struct norm_job {
	const struct dvsm_run *run;
	const float *x, *weight;
	void *out;
	size_t rows, width;
};

static void norm_task(void *context, size_t index, uint32_t worker)
{
	const struct norm_job *job = context;
	const struct dvsm_model_config *config = &job->run->model->config;
	size_t at = index * ROWS_PER_TASK * config->dim;

	(void)worker;
	job->run->kernels->layer_norm(
		job->x + at, dvsm_tile_length(job->rows, ROWS_PER_TASK, index), config->dim,
		job->weight, (float)config->norm_eps,
		dvsm_run_left(job->run, job->out, index * ROWS_PER_TASK, 0, config->dim));
}

static void embed_norm_task(void *context, size_t index, uint32_t worker)
{
	const struct norm_job *job = context;
	const struct dvsm_model_config *config = &job->run->model->config;
	size_t at = index * ROWS_PER_TASK * config->dim;

	(void)worker;
	job->run->kernels->embed_norm(
		job->x + at, dvsm_tile_length(job->rows, ROWS_PER_TASK, index), config->dim,
		job->weight, (float)config->norm_eps, (float *)job->out + at);
}

void dvsm_step_embed_norm(const struct dvsm_run *run, float *x, size_t rows, const float *weight)
{
	struct norm_job job = {.run = run, .x = x, .weight = weight, .out = x, .rows = rows};

	dvsm_pool_run(run->pool, dvsm_tiles(rows, ROWS_PER_TASK), embed_norm_task, &job);
}

static void convert_task(void *context, size_t index, uint32_t worker)
{
	const struct norm_job *job = context;
	size_t at = index * ROWS_PER_TASK * job->width;

	(void)worker;
	job->run->kernels->left(
		job->x + at, job->width, dvsm_tile_length(job->rows, ROWS_PER_TASK, index),
		job->width, dvsm_run_left(job->run, job->out, index * ROWS_PER_TASK, 0, job->width),
		job->width, 0);
}

void dvsm_step_convert(const struct dvsm_run *run, const float *x, size_t rows, size_t width,
		       void *out)
{
	struct norm_job job = {.run = run, .x = x, .out = out, .rows = rows, .width = width};

	if (out != x)
		dvsm_pool_run(run->pool, dvsm_tiles(rows, ROWS_PER_TASK), convert_task, &job);
}

void dvsm_step_norm(const struct dvsm_run *run, const float *x, size_t rows, const float *weight,
		    void *out)
{
	struct norm_job job = {.run = run, .x = x, .weight = weight, .out = out, .rows = rows};

	dvsm_pool_run(run->pool, dvsm_tiles(rows, ROWS_PER_TASK), norm_task, &job);
}

struct product_job {
	const struct dvsm_run *run;
	const void *a;
	size_t rows;
	const struct dvsm_matrix *w;
	unsigned char *c;
	size_t c_stride;
	enum dvsm_epilogue epilogue;
};

/* The panels of column `col` on, a whole number of panels. */
static const void *panels_at(const struct dvsm_run *run, const struct dvsm_matrix *w, size_t col)
{
	if (run->kernels->number_bytes == sizeof(float))
		return w->panels + col * w->in;
	return w->pairs + col * dvsm_bf16_depth(w->in);
}

void dvsm_rows_product(const struct dvsm_run *run, const void *a, size_t rows,
		       const struct dvsm_matrix *w, void *c, size_t c_stride,
		       enum dvsm_epilogue epilogue)
{
	const struct dvsm_kernels *kernels = run->kernels;
	/* Tiles call the weights that come next on their own; elsewhere columns stay in the cache.
	 */
	const size_t cols = kernels->tiled ? w->out : kernels->product_cols;
	const size_t most = kernels->product_rows, bytes = kernels->number_bytes;

	for (size_t i = 0; i < dvsm_tiles(w->out, cols); i++) {
		for (size_t j = 0; j < dvsm_tiles(rows, most); j++) {
			size_t row = j * most, col = i * cols;
			size_t a_at = dvsm_left_place(kernels, row, 0, w->in) * bytes;
			size_t c_at = (row * c_stride + col) * sizeof(float);

			if (epilogue == DVSM_EPILOGUE_GELU)
				c_at = dvsm_left_place(kernels, row, col, c_stride) * bytes;
			kernels->gemm((const unsigned char *)a + a_at, w->in,
				      dvsm_tile_length(rows, most, j), panels_at(run, w, col),
				      w->in, dvsm_tile_length(w->out, cols, i),
				      (unsigned char *)c + c_at, c_stride, epilogue);
		}
	}
}

static void product_task(void *context, size_t index, uint32_t worker)
{
	const struct product_job *job = context;
	const struct dvsm_matrix *w = job->w;
	const struct dvsm_kernels *kernels = job->run->kernels;
	size_t row_tiles = dvsm_tiles(job->rows, kernels->product_rows);
	size_t row_tile = index % row_tiles, col_tile = index / row_tiles;
	size_t row = row_tile * kernels->product_rows, col = col_tile * kernels->product_cols;
	size_t a_at = dvsm_left_place(kernels, row, 0, w->in) * kernels->number_bytes;
	size_t c_at = (row * job->c_stride + col) * sizeof(float);

	(void)worker;
	if (job->epilogue == DVSM_EPILOGUE_GELU)
		c_at = dvsm_left_place(kernels, row, col, job->c_stride) * kernels->number_bytes;
	kernels->gemm((const unsigned char *)job->a + a_at, w->in,
		      dvsm_tile_length(job->rows, kernels->product_rows, row_tile),
		      panels_at(job->run, w, col), w->in,
		      dvsm_tile_length(w->out, kernels->product_cols, col_tile), job->c + c_at,
		      job->c_stride, job->epilogue);
}

void dvsm_step_product(const struct dvsm_run *run, const void *a, size_t rows,
		       const struct dvsm_matrix *w, void *c, size_t c_stride,
		       enum dvsm_epilogue epilogue)
{
	struct product_job job = {
		.run = run,
		.a = a,
		.rows = rows,
		.w = w,
		.c = c,
		.c_stride = c_stride,
		.epilogue = epilogue,
	};

	dvsm_pool_run(run->pool,
		      dvsm_tiles(rows, run->kernels->product_rows) *
			      dvsm_tiles(w->out, run->kernels->product_cols),
		      product_task, &job);
}
