#include "forward/steps.h"

#include <math.h>

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

struct heads_job {
	const struct dvsm_run *run;
	const float *from;
	size_t stride, rows, first;
	const float *weight;
	const struct dvsm_heads *heads;
};

static void keys_task(void *context, size_t index, uint32_t worker)
{
	const struct heads_job *job = context;
	const struct dvsm_model_config *config = &job->run->model->config;
	size_t head_dim = config->dim / config->heads;
	size_t start = index * ROWS_PER_TASK;
	size_t rows = dvsm_tile_length(job->rows, ROWS_PER_TASK, index);

	(void)worker;
	for (size_t h = 0; h < config->heads; h++) {
		const float *from = job->from + start * job->stride + h * head_dim;
		size_t to = (h * job->heads->total + job->first + start) * head_dim;

		job->run->kernels->key_norm(
			from, job->stride, rows, head_dim, job->weight, (float)config->norm_eps,
			dvsm_run_number(job->run, job->heads->keys, to), head_dim);
		job->run->kernels->convert(from + config->dim, job->stride, rows, head_dim,
					   dvsm_run_number(job->run, job->heads->values, to),
					   head_dim);
	}
}

void dvsm_step_keys(const struct dvsm_run *run, const float *kv, size_t kv_stride, size_t rows,
		    const float *k_norm, const struct dvsm_heads *heads, size_t first)
{
	struct heads_job job = {
		.run = run,
		.from = kv,
		.stride = kv_stride,
		.rows = rows,
		.first = first,
		.weight = k_norm,
		.heads = heads,
	};

	dvsm_pool_run(run->pool, dvsm_tiles(rows, ROWS_PER_TASK), keys_task, &job);
}

struct attention_job {
	const struct dvsm_run *run;
	const float *q;
	size_t q_stride, rows;
	const struct dvsm_heads *heads;
	const float *q_norm;
	float bound;
	void *out;
};

static void attention_task(void *context, size_t index, uint32_t worker)
{
	const struct attention_job *job = context;
	const struct dvsm_model_config *config = &job->run->model->config;
	const size_t head_dim = config->dim / config->heads;
	const size_t most = job->run->kernels->attention_queries;
	size_t tiles = dvsm_tiles(job->rows, most);
	size_t head = index / tiles, row = index % tiles * most;
	size_t base = head * job->heads->total * head_dim;
	unsigned char *scratch = dvsm_run_scratch(job->run, worker);
	float *q = (float *)(void *)(scratch + dvsm_attention_scratch(head_dim));
	struct dvsm_attention attention = {
		.q = q,
		.q_stride = head_dim,
		.queries = dvsm_tile_length(job->rows, most, index % tiles),
		.k = dvsm_run_read(job->run, job->heads->keys, base),
		.v = dvsm_run_read(job->run, job->heads->values, base),
		.keys = job->heads->total,
		.head_dim = head_dim,
		.scale = 1.0f / sqrtf((float)head_dim),
		.out = dvsm_run_left(job->run, job->out, row, 0, config->dim),
		.out_stride = config->dim,
		.scratch = scratch,
		.out_col = head * head_dim,
		.bound = job->bound,
	};

	job->run->kernels->query_norm(job->q + row * job->q_stride + head * head_dim, job->q_stride,
				      attention.queries, head_dim, job->q_norm,
				      (float)config->norm_eps, q, head_dim);
	job->run->kernels->attention(&attention);
}

void dvsm_step_attention(const struct dvsm_run *run, const float *q, size_t q_stride, size_t rows,
			 const float *q_norm, float bound, const struct dvsm_heads *heads,
			 void *out)
{
	struct attention_job job = {run, q, q_stride, rows, heads, q_norm, bound, out};

	dvsm_pool_run(run->pool,
		      run->model->config.heads * dvsm_tiles(rows, run->kernels->attention_queries),
		      attention_task, &job);
}
