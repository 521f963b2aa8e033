#include <string.h>

#include "fixed/run.h"

/* Tokens that make a task where the work on each is small. */
#define ROWS_PER_TASK 16u

/* A task of a product: 64 rows of A stay in the first-level cache while the columns pass by. */
#define PRODUCT_ROWS 64u
#define PRODUCT_COLS 128u

/* Channels that make a task of finding ranges. */
#define RANGE_CHANNELS 64u

static size_t tiles(size_t count, size_t size)
{
	return (count + size - 1) / size;
}

static size_t tile_length(size_t count, size_t size, size_t index)
{
	size_t left = count - index * size;

	return left < size ? left : size;
}

/* ---- norms and quantisation ---- */

struct rows_job {
	const struct dvsm_fixed_run *run;
	const int32_t *x;
	const int16_t *narrow;
	const struct dvsm_fixed_gain *gain;
	bool fine;
	size_t rows, dim, depth;
	int fraction;
};

static void norm_task(void *context, size_t index, uint32_t worker)
{
	const struct rows_job *job = context;
	const struct dvsm_fixed_workspace *work = &job->run->work;
	size_t row = index * ROWS_PER_TASK;
	struct dvsm_fixed_norm norm = {
		.x = job->x + row * job->dim,
		.rows = tile_length(job->rows, ROWS_PER_TASK, index),
		.dim = job->dim,
		.gain = *job->gain,
		.fine = job->fine,
		.high = work->a + row * job->depth,
		.low = work->a_low + row * job->depth,
		.out_stride = job->depth,
		.a_scale = work->a_scale + row,
	};

	(void)worker;
	job->run->kernels->norm(&norm);
}

void dvsm_fixed_step_norm(const struct dvsm_fixed_run *run, const int32_t *x, size_t rows,
			  const struct dvsm_fixed_gain *gain, bool fine)
{
	struct rows_job job = {
		.run = run,
		.x = x,
		.gain = gain,
		.fine = fine,
		.rows = rows,
		.dim = run->config->dim,
		.depth = dvsm_fixed_pad(run->config->dim, DVSM_FIXED_DEPTH),
	};

	dvsm_pool_run(run->pool, tiles(rows, ROWS_PER_TASK), norm_task, &job);
}

static void quantise_task(void *context, size_t index, uint32_t worker)
{
	const struct rows_job *job = context;
	const struct dvsm_fixed_workspace *work = &job->run->work;
	size_t row = index * ROWS_PER_TASK;
	struct dvsm_fixed_quantise quantise = {
		.x = job->narrow + row * job->dim,
		.x_stride = job->dim,
		.rows = tile_length(job->rows, ROWS_PER_TASK, index),
		.dim = job->dim,
		.fraction = job->fraction,
		.a = work->a + row * job->depth,
		.a_stride = job->depth,
		.a_scale = work->a_scale + row,
	};

	(void)worker;
	job->run->kernels->quantise(&quantise);
}

void dvsm_fixed_step_quantise(const struct dvsm_fixed_run *run, const int16_t *x, size_t rows,
			      size_t dim, int fraction)
{
	struct rows_job job = {
		.run = run,
		.narrow = x,
		.rows = rows,
		.dim = dim,
		.depth = dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH),
		.fraction = fraction,
	};

	dvsm_pool_run(run->pool, tiles(rows, ROWS_PER_TASK), quantise_task, &job);
}

/* ---- products ---- */

struct product_job {
	const struct dvsm_fixed_run *run;
	const int8_t *a;
	size_t rows;
	const struct dvsm_fixed_matrix *w;
	unsigned char *c;
	enum dvsm_fixed_epilogue epilogue;
	int fraction;
};

static void product_task(void *context, size_t index, uint32_t worker)
{
	const struct product_job *job = context;
	const struct dvsm_fixed_matrix *w = job->w;
	size_t row_tiles = tiles(job->rows, PRODUCT_ROWS);
	size_t row = index % row_tiles * PRODUCT_ROWS, col = index / row_tiles * PRODUCT_COLS;
	size_t number = job->epilogue == DVSM_FIXED_ADD ? sizeof(int32_t) : sizeof(int16_t);
	struct dvsm_fixed_gemm gemm = {
		.a = job->a + row * w->depth,
		.a_stride = w->depth,
		.a_scale = job->run->work.a_scale + row,
		.rows = tile_length(job->rows, PRODUCT_ROWS, index % row_tiles),
		.depth = w->depth,
		.panels = w->panels + col * w->depth,
		.w_sum = w->sums + col,
		.w_mantissa = w->mantissas + col,
		.w_shift = w->shifts + col,
		.cols = tile_length(w->out, PRODUCT_COLS, index / row_tiles),
		.c = job->c + (row * w->out + col) * number,
		.c_stride = w->out,
		.epilogue = job->epilogue,
		.fraction = job->fraction,
	};

	(void)worker;
	job->run->kernels->gemm(&gemm);
}

void dvsm_fixed_step_product(const struct dvsm_fixed_run *run, const int8_t *a, size_t rows,
			     const struct dvsm_fixed_matrix *w, void *c,
			     enum dvsm_fixed_epilogue epilogue, int fraction)
{
	struct product_job job = {run, a, rows, w, c, epilogue, fraction};

	dvsm_pool_run(run->pool, tiles(rows, PRODUCT_ROWS) * tiles(w->out, PRODUCT_COLS),
		      product_task, &job);
}

/* ---- queries, keys and values ---- */

struct heads_job {
	const struct dvsm_fixed_run *run;
	const struct dvsm_fixed_half *half;
	const int16_t *u;
	int16_t *kv;
	size_t rows;
	const struct dvsm_fixed_slots *slots;
	const struct dvsm_fixed_layer *layer;
};

static void queries_task(void *context, size_t index, uint32_t worker)
{
	const struct heads_job *job = context;
	const struct dvsm_model_config *config = job->run->config;
	size_t width = dvsm_fixed_pad(config->dim / config->heads, DVSM_FIXED_HEAD);
	size_t row = index * ROWS_PER_TASK;
	struct dvsm_fixed_queries queries = {
		.u = job->u + row * config->dim,
		.u_stride = config->dim,
		.rows = tile_length(job->rows, ROWS_PER_TASK, index),
		.heads = config->heads,
		.dim = config->dim / config->heads,
		.head_width = width,
		.gains = job->slots->gains,
		.q = job->run->work.q + row * config->heads * width,
		.q_scale = job->run->work.q_scale + row * config->heads,
	};

	(void)worker;
	job->run->kernels->queries(&queries);
}

void dvsm_fixed_step_queries(const struct dvsm_fixed_run *run, const int16_t *u, size_t rows,
			     const struct dvsm_fixed_slots *slots)
{
	struct heads_job job = {.run = run, .u = u, .rows = rows, .slots = slots};

	dvsm_pool_run(run->pool, tiles(rows, ROWS_PER_TASK), queries_task, &job);
}

static void keys_task(void *context, size_t index, uint32_t worker)
{
	const struct heads_job *job = context;
	const struct dvsm_model_config *config = job->run->config;
	size_t stride = 2 * (size_t)config->dim, dim = config->dim / config->heads;

	(void)worker;
	for (size_t h = 0; h < config->heads; h++) {
		int16_t *at = job->kv + index * ROWS_PER_TASK * stride + h * dim;
		struct dvsm_fixed_keys keys = {
			.u = at,
			.u_stride = stride,
			.rows = tile_length(job->rows, ROWS_PER_TASK, index),
			.dim = dim,
			.epsilon = job->half->key_epsilon[h],
			.root = job->run->model->root_head,
			.fraction = job->run->model->key_fraction,
			.n = at,
			.n_stride = stride,
		};

		job->run->kernels->keys(&keys);
	}
}

void dvsm_fixed_step_keys(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			  int16_t *kv, size_t rows)
{
	struct heads_job job = {.run = run, .half = half, .kv = kv, .rows = rows};

	dvsm_pool_run(run->pool, tiles(rows, ROWS_PER_TASK), keys_task, &job);
}

/* Threads share the channels, not the rows: nothing is left to be put together. */
static void range_task(void *context, size_t index, uint32_t worker)
{
	const struct heads_job *job = context;
	const size_t width = 2 * (size_t)job->run->config->dim, first = index * RANGE_CHANNELS;
	size_t count = tile_length(width, RANGE_CHANNELS, index);
	struct dvsm_fixed_range *ranges = job->run->work.ranges + first;

	(void)worker;
	for (size_t d = 0; d < count; d++)
		ranges[d] = (struct dvsm_fixed_range){0, INT16_MAX, INT16_MIN};
	job->run->kernels->range(job->u + first, width, job->rows, count, ranges);
}

static void pack_task(void *context, size_t index, uint32_t worker)
{
	const struct heads_job *job = context;
	const struct dvsm_model_config *config = job->run->config;
	const struct dvsm_fixed_layer *layer = job->layer;
	size_t dim = config->dim / config->heads, first = index * DVSM_FIXED_KEY_PAD;
	size_t head_bytes = dvsm_fixed_head_bytes(layer->padded, config->dim, config->heads);
	struct dvsm_fixed_pack pack = {
		.x_stride = 2 * (size_t)config->dim,
		.rows = tile_length(job->rows, DVSM_FIXED_KEY_PAD, index),
		.dim = dim,
		.head_width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD),
		.first = first,
	};
	size_t bytes = DVSM_FIXED_KEY_PAD * pack.head_width, start = first * pack.head_width;
	bool padding = pack.rows < DVSM_FIXED_KEY_PAD || dim < pack.head_width;

	(void)worker;
	for (size_t h = 0; h < config->heads; h++) {
		if (padding) {
			memset(layer->keys + h * head_bytes + start, 0, bytes);
			memset(layer->values + h * head_bytes + start, 0, bytes);
		}
		pack.x = job->u + first * pack.x_stride + h * dim;
		pack.channels = job->run->work.channels + h * dim;
		pack.packed = layer->keys + h * head_bytes;
		job->run->kernels->pack_keys(&pack);
		pack.x += config->dim;
		pack.channels += config->dim;
		pack.packed = layer->values + h * head_bytes;
		job->run->kernels->pack_values(&pack);
	}
}

void dvsm_fixed_step_pack(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			  const int16_t *kv, struct dvsm_fixed_layer *layer)
{
	struct heads_job job = {.run = run, .u = kv, .rows = layer->tokens, .layer = layer};

	dvsm_pool_run(run->pool, tiles(2 * (size_t)run->config->dim, RANGE_CHANNELS), range_task,
		      &job);
	dvsm_fixed_layer_scale(half, run->config->dim, run->work.ranges, layer, run->work.channels);
	dvsm_pool_run(run->pool, tiles(layer->tokens, DVSM_FIXED_KEY_PAD), pack_task, &job);
}

/* ---- attention ---- */

static void attention_task(void *context, size_t index, uint32_t worker)
{
	const struct heads_job *job = context;
	const struct dvsm_model_config *config = job->run->config;
	const struct dvsm_fixed_workspace *work = &job->run->work;
	const struct dvsm_fixed_layer *layer = job->layer;
	size_t row_tiles = tiles(job->rows, DVSM_FIXED_QUERIES);
	size_t row = index % row_tiles * DVSM_FIXED_QUERIES, head = index / row_tiles;
	size_t dim = config->dim / config->heads, width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD);
	size_t head_bytes = dvsm_fixed_head_bytes(layer->padded, config->dim, config->heads);
	struct dvsm_fixed_attention attention = {
		.q = work->q + (row * config->heads + head) * width,
		.q_stride = config->heads * width,
		.q_scale = work->q_scale + row * config->heads + head,
		.scale_stride = config->heads,
		.queries = tile_length(job->rows, DVSM_FIXED_QUERIES, index % row_tiles),
		.k = layer->keys + head * head_bytes,
		.v = layer->values + head * head_bytes,
		.keys = layer->tokens,
		.dim = dim,
		.head_width = width,
		.v_scale = layer->v_scale + head * dim,
		.v_mean = layer->v_mean + head * dim,
		.out = work->mixed + row * config->dim + head * dim,
		.out_stride = config->dim,
		.scratch = dvsm_fixed_scratch(job->run, worker),
	};

	job->run->kernels->attention(&attention);
}

void dvsm_fixed_step_attention(const struct dvsm_fixed_run *run, size_t rows,
			       const struct dvsm_fixed_layer *layer)
{
	struct heads_job job = {.run = run, .rows = rows, .layer = layer};

	dvsm_pool_run(run->pool, run->config->heads * tiles(rows, DVSM_FIXED_QUERIES),
		      attention_task, &job);
}
