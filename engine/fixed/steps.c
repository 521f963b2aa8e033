#include "fixed/fine.h"
#include "fixed/run.h"
#include "kernels/fixed_math.h"

/* Tokens that make a task where the work on each is small, or lie in a thread's scratch. */
#define ROWS_PER_TASK DVSM_FIXED_FEW_ROWS

/* Columns of a task of a product: its rows of A stay in the first-level cache while they pass by.
 * Few threads take twice as many, as beginnings and ends of calls are what their units wait for.
 */
#define TASK_COLS   192u
#define FEW_THREADS 4u

_Static_assert(DVSM_FIXED_TASK_ROWS <= DVSM_FIXED_QUERIES,
	       "attention takes the rows of a task at once");

/*
 * A job is cut into tiles of rows, and these into pieces: columns of a product, heads. Tasks come
 * in the order of parts, of as many tiles each as there are threads to share them: so a thread
 * finds in its cache the rows that it wrote in the job before. Within a part the tiles pass by each
 * piece, whose weights or keys stay in the cache meanwhile.
 */
struct cut {
	size_t rows, tile_rows, row_tiles, pieces, parts;
};

/* Tiles of `most` rows, or of fewer where that gives every thread as many. */
static struct cut cut_rows(const struct dvsm_fixed_run *run, size_t rows, size_t most,
			   size_t pieces)
{
	const size_t threads = dvsm_pool_get_threads(run->pool);
	struct cut cut = {.rows = rows, .tile_rows = rows, .pieces = pieces};

	for (size_t shares = threads; cut.tile_rows > most; shares += threads)
		cut.tile_rows = dvsm_tiles(rows, shares);
	if (cut.tile_rows == rows)
		cut.tile_rows = dvsm_tiles(rows, threads);
	cut.tile_rows = dvsm_fixed_pad(cut.tile_rows, ROWS_PER_TASK);
	if (cut.tile_rows < DVSM_FIXED_LEAST_TASK_ROWS)
		cut.tile_rows = DVSM_FIXED_LEAST_TASK_ROWS;
	cut.row_tiles = dvsm_tiles(rows, cut.tile_rows);
	cut.parts = cut.row_tiles < threads ? cut.row_tiles : threads;
	return cut;
}

static size_t count_tasks(const struct cut *cut)
{
	return cut->row_tiles * cut->pieces;
}

/* The tile of rows and the piece of a task. */
static void find_task(const struct cut *cut, size_t index, size_t *row_tile, size_t *piece)
{
	const size_t share = cut->row_tiles / cut->parts, rest = cut->row_tiles % cut->parts;
	const size_t larger = rest * (share + 1) * cut->pieces; /* tasks of parts with one more */
	const size_t size = index < larger ? share + 1 : share;
	const size_t at = index < larger ? index : index - larger;
	const size_t part = at / (size * cut->pieces), within = at % (size * cut->pieces);

	*row_tile = (index < larger ? 0 : rest * (share + 1)) + part * size + within % size;
	*piece = within / size;
}

/* ---- norms and quantisation of some rows ---- */

static void norm_rows(const struct dvsm_fixed_run *run, const int32_t *x,
		      const struct dvsm_fixed_gain *gain, bool fine, size_t row, size_t rows)
{
	const struct dvsm_fixed_workspace *work = &run->work;
	const size_t dim = run->config->dim, depth = dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH);
	struct dvsm_fixed_norm norm = {
		.x = x + row * dim,
		.rows = rows,
		.dim = dim,
		.gain = *gain,
		.fine = fine,
		.high = work->a + row * depth,
		.low = work->a_low + row * depth,
		.out_stride = depth,
		.a_scale = work->a_scale + row,
	};

	run->kernels->norm(&norm);
}

/* Both planes of few rows side by side, by way of the scratch. */
static void norm_few_rows_fine(const struct dvsm_fixed_run *run, const int32_t *x,
			       const struct dvsm_fixed_gain *gain,
			       const struct dvsm_fixed_matrix *input, size_t row, size_t rows,
			       uint32_t worker)
{
	const size_t plane = input->depth / 2;
	int8_t *planes = dvsm_fixed_scratch(run, worker);
	struct dvsm_fixed_norm norm = {
		.x = x + row * input->in,
		.rows = rows,
		.dim = input->in,
		.gain = *gain,
		.fine = true,
		.high = planes,
		.low = planes + ROWS_PER_TASK * plane,
		.out_stride = plane,
		.a_scale = run->work.a_scale + row,
	};

	run->kernels->norm(&norm);
	for (size_t i = 0; i < rows; i++) {
		dvsm_fixed_fine_join(norm.high + i * plane, norm.low + i * plane, plane,
				     run->work.a + (row + i) * input->depth);
		norm.a_scale[i] = dvsm_fixed_shift(norm.a_scale[i], 7);
	}
}

static void norm_rows_for(const struct dvsm_fixed_run *run, const int32_t *x,
			  const struct dvsm_fixed_gain *gain, const struct dvsm_fixed_matrix *input,
			  size_t row, size_t rows, uint32_t worker)
{
	if (!input->fine)
		norm_rows(run, x, gain, false, row, rows);
	for (size_t i = 0; input->fine && i < rows; i += ROWS_PER_TASK)
		norm_few_rows_fine(run, x, gain, input, row + i,
				   dvsm_tile_length(rows, ROWS_PER_TASK, i / ROWS_PER_TASK),
				   worker);
}

static void quantise_rows(const struct dvsm_fixed_run *run, const struct dvsm_fixed_then *then,
			  size_t row, size_t rows)
{
	const size_t dim = then->input->in, depth = then->input->depth;
	const struct dvsm_fixed_quantise quantise = {
		.x = then->wide + row * dim,
		.x_stride = dim,
		.rows = rows,
		.dim = dim,
		.fraction = then->fraction,
		.a = then->to + row * depth,
		.a_stride = depth,
		.a_scale = run->work.a_scale + row,
	};
	const struct dvsm_fixed_split split = {
		.x = quantise.x,
		.x_stride = dim,
		.rows = rows,
		.dim = dim,
		.fraction = then->fraction,
		.planes = quantise.a,
		.plane = depth / 2,
		.a_scale = quantise.a_scale,
	};

	if (then->input->fine)
		run->kernels->split(&split);
	else
		run->kernels->quantise(&quantise);
}

static void key_rows(const struct dvsm_fixed_run *run, const struct dvsm_fixed_then *then,
		     size_t row, size_t rows)
{
	const struct dvsm_model_config *config = run->config;
	const size_t stride = 2 * (size_t)config->dim, dim = config->dim / config->heads;

	for (size_t h = 0; h < config->heads; h++) {
		int16_t *at = then->kv + row * stride + h * dim;
		struct dvsm_fixed_keys keys = {
			.u = at,
			.u_stride = stride,
			.rows = rows,
			.dim = dim,
			.epsilon = then->half->key_epsilon[h],
			.root = run->model->root_head,
			.fraction = run->model->key_fraction,
			.n = at,
			.n_stride = stride,
		};

		run->kernels->keys(&keys);
	}
}

/* ---- what is done behind rows ---- */

static void expect(const struct dvsm_fixed_run *run, const struct dvsm_fixed_then *then,
		   const struct cut *cut, size_t tasks)
{
	for (size_t i = 0; then->what != DVSM_FIXED_NOTHING && i < cut->row_tiles; i++)
		atomic_store_explicit(&run->work.left[i], (uint32_t)tasks, memory_order_relaxed);
}

/* A task is done with its rows: the last of them goes on. */
static void arrive(const struct dvsm_fixed_run *run, const struct dvsm_fixed_then *then,
		   const struct cut *cut, size_t row_tile, uint32_t worker)
{
	const size_t row = row_tile * cut->tile_rows;
	const size_t rows = dvsm_tile_length(cut->rows, cut->tile_rows, row_tile);

	if (then->what == DVSM_FIXED_NOTHING ||
	    atomic_fetch_sub_explicit(&run->work.left[row_tile], 1, memory_order_acq_rel) > 1)
		return;
	if (then->what == DVSM_FIXED_NORM)
		norm_rows_for(run, then->x, then->gain, then->input, row, rows, worker);
	else if (then->what == DVSM_FIXED_KEYS_16)
		key_rows(run, then, row, rows);
	else
		quantise_rows(run, then, row, rows);
}

/* ---- norms ---- */

struct norm_job {
	const struct dvsm_fixed_run *run;
	const int32_t *x;
	const struct dvsm_fixed_gain *gain;
	const struct dvsm_fixed_matrix *input; /* NULL: two products, a plane each */
	size_t rows;
};

static void norm_task(void *context, size_t index, uint32_t worker)
{
	const struct norm_job *job = context;
	const size_t row = index * ROWS_PER_TASK;
	const size_t rows = dvsm_tile_length(job->rows, ROWS_PER_TASK, index);

	if (job->input)
		norm_rows_for(job->run, job->x, job->gain, job->input, row, rows, worker);
	else
		norm_rows(job->run, job->x, job->gain, true, row, rows);
}

void dvsm_fixed_step_norm(const struct dvsm_fixed_run *run, const int32_t *x, size_t rows,
			  const struct dvsm_fixed_gain *gain, const struct dvsm_fixed_matrix *input)
{
	struct norm_job job = {run, x, gain, input, rows};

	dvsm_pool_run(run->pool, dvsm_tiles(rows, ROWS_PER_TASK), norm_task, &job);
}

void dvsm_fixed_step_norm_planes(const struct dvsm_fixed_run *run, const int32_t *x, size_t rows,
				 const struct dvsm_fixed_gain *gain)
{
	struct norm_job job = {run, x, gain, NULL, rows};

	dvsm_pool_run(run->pool, dvsm_tiles(rows, ROWS_PER_TASK), norm_task, &job);
}

/* ---- products ---- */

struct product_job {
	const struct dvsm_fixed_run *run;
	const struct dvsm_fixed_product *products;
	size_t task_cols;
	size_t first_cols; /* tiles of columns of the first product */
	struct cut cut;
};

static void product_task(void *context, size_t index, uint32_t worker)
{
	const struct product_job *job = context;
	size_t row_tile, piece;

	find_task(&job->cut, index, &row_tile, &piece);

	const bool second = piece >= job->first_cols;
	const struct dvsm_fixed_product *product = &job->products[second];
	const struct dvsm_fixed_matrix *w = product->w;
	const size_t col_tile = second ? piece - job->first_cols : piece;
	const size_t row = row_tile * job->cut.tile_rows, col = col_tile * job->task_cols;
	const size_t number =
		product->epilogue == DVSM_FIXED_ADD ? sizeof(int32_t) : sizeof(int16_t);
	struct dvsm_fixed_gemm gemm = {
		.a = product->a + row * w->depth,
		.a_stride = w->depth,
		.a_scale = job->run->work.a_scale + row,
		.rows = dvsm_tile_length(job->cut.rows, job->cut.tile_rows, row_tile),
		.depth = w->depth,
		.panels = w->panels + col * w->depth,
		.w_sum = w->sums + col,
		.w_mantissa = w->mantissas + col,
		.w_shift = w->shifts + col,
		.cols = dvsm_tile_length(w->out, job->task_cols, col_tile),
		.c = (unsigned char *)product->c + (row * w->out + col) * number,
		.c_stride = w->out,
		.epilogue = product->epilogue,
		.fraction = product->fraction,
	};

	job->run->kernels->gemm(&gemm);
	arrive(job->run, &product->then, &job->cut, row_tile, worker);
}

void dvsm_fixed_step_products(const struct dvsm_fixed_run *run, size_t rows,
			      const struct dvsm_fixed_product *products, size_t count)
{
	const bool few = dvsm_pool_get_threads(run->pool) <= FEW_THREADS;
	const size_t task_cols = few ? 2 * TASK_COLS : TASK_COLS;
	struct product_job job = {.run = run,
				  .products = products,
				  .task_cols = task_cols,
				  .first_cols = dvsm_tiles(products[0].w->out, task_cols)};
	size_t cols = job.first_cols;

	if (count > 1)
		cols += dvsm_tiles(products[1].w->out, task_cols);
	job.cut = cut_rows(run, rows, DVSM_FIXED_TASK_ROWS, cols);
	expect(run, &products[0].then, &job.cut, job.first_cols);
	dvsm_pool_run(run->pool, count_tasks(&job.cut), product_task, &job);
}

/* ---- attention ---- */

struct attention_job {
	const struct dvsm_fixed_run *run;
	const struct dvsm_fixed_half *half;
	const int16_t *u;
	struct cut cut;
	const struct dvsm_fixed_layers *layers;
	struct dvsm_fixed_then then;
};

/* The 16-bit queries of a head to int8, into the scratch. */
static void queries(const struct attention_job *job, const struct dvsm_fixed_gain *gain,
		    size_t head, size_t row, size_t rows,
		    const struct dvsm_fixed_head_scratch *scratch)
{
	const struct dvsm_model_config *config = job->run->config;
	const size_t dim = config->dim / config->heads;
	const struct dvsm_fixed_queries made = {
		.u = job->u + row * config->dim + head * dim,
		.u_stride = config->dim,
		.rows = rows,
		.heads = 1,
		.dim = dim,
		.head_width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD),
		.gains = gain,
		.q = scratch->q,
		.q_scale = scratch->q_scale,
	};

	job->run->kernels->queries(&made);
}

/*
 * The same to two planes: QK-norm as keys have it, times the gain in 16 bits, split. What a unit of
 * a score is worth has the gain, sqrt(dim) of the norm and the planes' binary point in it.
 */
static void fine_queries(const struct attention_job *job, const struct dvsm_fixed_gain *gain,
			 size_t head, size_t row, size_t rows,
			 const struct dvsm_fixed_head_scratch *scratch)
{
	const struct dvsm_fixed_run *run = job->run;
	const size_t dim = run->config->dim / run->config->heads;
	const int fraction = run->model->key_fraction;
	const struct dvsm_fixed_scale unit =
		dvsm_fixed_multiply(dvsm_fixed_rsqrt(dim), dvsm_fixed_shift(gain->scale, 15));
	int16_t *n = scratch->rest;
	const struct dvsm_fixed_keys norm = {
		.u = job->u + row * run->config->dim + head * dim,
		.u_stride = run->config->dim,
		.rows = rows,
		.dim = dim,
		.epsilon = gain->epsilon,
		.root = run->model->root_head,
		.fraction = fraction,
		.n = n,
		.n_stride = dim,
	};
	const struct dvsm_fixed_split split = {
		.x = n,
		.x_stride = dim,
		.rows = rows,
		.dim = dim,
		.fraction = fraction,
		.planes = scratch->q,
		.plane = dvsm_fixed_fine_width(dim) / 2,
		.a_scale = scratch->q_scale,
	};

	run->kernels->keys(&norm);
	for (size_t i = 0; i < rows; i++)
		dvsm_fixed_fine_weigh(n + i * dim, gain->gain, dim);
	run->kernels->split(&split);
	for (size_t i = 0; i < rows; i++)
		scratch->q_scale[i] = dvsm_fixed_multiply(scratch->q_scale[i], unit);
}

/* One head's attention of rows row .. row + rows - 1 to one layer. */
static void attend(const struct attention_job *job, size_t head, size_t row, size_t rows,
		   const struct dvsm_fixed_layer *layer, uint32_t worker)
{
	const struct dvsm_model_config *config = job->run->config;
	const size_t dim = config->dim / config->heads;
	const size_t head_width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD);
	const size_t head_bytes = dvsm_fixed_head_bytes(layer->padded, config->dim, config->heads);
	const bool fine = layer->fine_keys;
	const size_t key_width = fine ? dvsm_fixed_fine_width(dim) : head_width;
	const struct dvsm_fixed_head_scratch scratch =
		dvsm_fixed_head_scratch_place(dvsm_fixed_scratch(job->run, worker), dim);
	const struct dvsm_fixed_gain gain = dvsm_fixed_query_gain(
		job->run->model, job->half, head, dim, layer->k_scale + head * dim, scratch.gains);
	const struct dvsm_fixed_attention attention = {
		.q = scratch.q,
		.q_stride = key_width,
		.q_scale = scratch.q_scale,
		.scale_stride = 1,
		.queries = rows,
		.k = fine ? dvsm_fixed_head_fine_keys(layer, head, dim)
			  : layer->keys + head * head_bytes,
		.v = layer->values + head * head_bytes,
		.keys = layer->tokens,
		.dim = dim,
		.head_width = head_width,
		.key_width = key_width,
		.v_scale = layer->v_scale + head * dim,
		.v_mean = layer->v_mean + head * dim,
		.out = job->run->work.mixed + row * config->dim + head * dim,
		.out_stride = config->dim,
		.scratch = scratch.rest,
	};

	if (fine)
		fine_queries(job, &gain, head, row, rows, &scratch);
	else
		queries(job, &gain, head, row, rows, &scratch);
	job->run->kernels->attention(&attention);
}

/* The rows of a tile, those of each view to their own layer. */
static void attend_by_view(const struct attention_job *job, size_t head, size_t row, size_t rows,
			   uint32_t worker)
{
	const struct dvsm_group *group = job->layers->group;
	const size_t base = group->first_token[0];

	for (uint32_t v = 0; v < group->views; v++) {
		size_t first = group->first_token[v] - base, end = group->first_token[v + 1] - base;

		first = first > row ? first : row;
		end = end < row + rows ? end : row + rows;
		if (first < end) {
			struct dvsm_fixed_layer layer =
				dvsm_fixed_layers_get(job->run, job->layers, v);

			attend(job, head, first, end - first, &layer, worker);
		}
	}
}

static void attention_task(void *context, size_t index, uint32_t worker)
{
	const struct attention_job *job = context;
	size_t row_tile, head;

	find_task(&job->cut, index, &row_tile, &head);

	const size_t row = row_tile * job->cut.tile_rows;
	const size_t rows = dvsm_tile_length(job->cut.rows, job->cut.tile_rows, row_tile);

	if (job->layers->group)
		attend_by_view(job, head, row, rows, worker);
	else
		attend(job, head, row, rows, &job->layers->one, worker);
	arrive(job->run, &job->then, &job->cut, row_tile, worker);
}

void dvsm_fixed_step_attention(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			       const int16_t *u, size_t rows,
			       const struct dvsm_fixed_layers *layers, struct dvsm_fixed_then then)
{
	/* Keys that no cache holds serve as many queries as there may be. */
	const bool many = !layers->group && layers->one.tokens > DVSM_FIXED_MANY_KEYS;
	const size_t most = many ? run->kernels->attention_queries : DVSM_FIXED_TASK_ROWS;
	struct attention_job job = {run,    half, u, cut_rows(run, rows, most, run->config->heads),
				    layers, then};

	expect(run, &then, &job.cut, run->config->heads);
	dvsm_pool_run(run->pool, count_tasks(&job.cut), attention_task, &job);
}
