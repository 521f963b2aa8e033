#include "forward/block.h"

#include <math.h>
#include <string.h>

#include "forward/tile.h"
#include "kernels/bf16.h"

struct block_job {
	const struct dvsm_run *run;
	struct dvsm_cut cut;
	uint32_t layer;
	const struct dvsm_heads *cache;
};

/* ---- a tile's places ---- */

static float *residual(const struct dvsm_run *run, const struct dvsm_tile *tile)
{
	return run->work.x + tile->token * run->model->config.dim;
}

static void *normed(const struct dvsm_run *run, const struct dvsm_tile *tile)
{
	return dvsm_run_left(run, run->work.normed, tile->row, 0, run->model->config.dim);
}

/* Queries; hidden numbers. */
static float *wide(const struct dvsm_run *run, const struct dvsm_tile *tile)
{
	return run->work.wide + tile->row * run->work.wide_width;
}

/* Keys and values, behind the queries. */
static float *wide_keys(const struct dvsm_run *run, const struct dvsm_tile *tile)
{
	return wide(run, tile) + tile->rows * run->model->config.dim;
}

/* Keys and values of a view that begins in this row of the workspace. */
static struct dvsm_heads own_heads(const struct dvsm_run *run, size_t view_row, size_t view_tokens)
{
	const size_t at = view_row * run->model->config.dim;

	return (struct dvsm_heads){
		dvsm_run_number(run, run->work.keys, at),
		dvsm_run_number(run, run->work.values, at),
		view_tokens,
	};
}

/* ---- what a trace is told ---- */

/* Which half block these weights are: 2 layer, plus 1 for the cross-view half. */
static size_t half_of(const struct dvsm_run *run, const struct dvsm_half_weights *weights)
{
	const char *first = (const char *)run->weights->blocks;

	return (size_t)((const char *)weights - first) / sizeof(*weights);
}

/* Rows of a tile, [rows][width]; floats, because only float32 is traced. */
static void trace_rows(const struct dvsm_run *run, const struct dvsm_tile *tile,
		       const struct dvsm_half_weights *weights, enum dvsm_trace_what what,
		       const float *x, size_t width)
{
	if (run->trace)
		dvsm_trace_floats(run->trace, half_of(run, weights), what, tile->token, x,
				  tile->rows, width);
}

/* Keys and values within each view. */
static void trace_own_heads(const struct block_job *job)
{
	const struct dvsm_run *run = job->run;
	const struct dvsm_group *group = job->cut.group;
	size_t row = 0;

	for (uint32_t v = 0; run->trace && v < group->views; v++) {
		const struct dvsm_heads own = own_heads(run, row, dvsm_group_tokens(group, v));

		dvsm_trace_float_heads(run->trace, 2 * (size_t)job->layer, group->first_token[v],
				       own.keys, own.values, own.total);
		row += dvsm_cut_rows_of(&job->cut, own.total);
	}
}

/* ---- steps of a tile ---- */

static void norm(const struct dvsm_run *run, const struct dvsm_tile *tile, const float *weight)
{
	run->kernels->layer_norm(residual(run, tile), tile->rows, run->model->config.dim, weight,
				 (float)run->model->config.norm_eps, normed(run, tile));
}

/* Keys and values of the tile's normed rows, before QK-norm. */
static void project_keys(const struct dvsm_run *run, const struct dvsm_tile *tile,
			 const struct dvsm_half_weights *weights)
{
	dvsm_rows_product(run, normed(run, tile), tile->rows, &weights->key_value,
			  wide_keys(run, tile), 2 * (size_t)run->model->config.dim,
			  DVSM_EPILOGUE_STORE);
}

/* One head's keys and values of rows at .. at + rows - 1, with QK-norm, to k and v. */
static void finish_keys(const struct dvsm_run *run, const struct dvsm_tile *tile,
			const struct dvsm_half_weights *weights, size_t at, size_t rows,
			size_t head, void *k, void *v)
{
	const struct dvsm_model_config *config = &run->model->config;
	const size_t dim = config->dim, head_dim = dim / config->heads;
	const float *kv = wide_keys(run, tile) + at * 2 * dim + head * head_dim;

	run->kernels->key_norm(kv, 2 * dim, rows, head_dim, weights->k_norm,
			       (float)config->norm_eps, k, head_dim);
	run->kernels->convert(kv + dim, 2 * dim, rows, head_dim, v, head_dim);
}

/* Of `rows` keys and values from `first` of a head on, those of whole blocks to blocks, the others
 * as they are. */
static void place_keys(const struct dvsm_run *run, const void *k, const void *v, size_t rows,
		       const struct dvsm_heads *heads, size_t head, size_t first)
{
	const size_t head_dim = run->model->config.dim / run->model->config.heads;
	const size_t base = head * heads->total,
		     ahead = (first + DVSM_BLOCK_KEYS - 1) / DVSM_BLOCK_KEYS * DVSM_BLOCK_KEYS -
			     first;
	const size_t before = ahead < rows ? ahead : rows;
	const size_t whole = (rows - before) / DVSM_BLOCK_KEYS * DVSM_BLOCK_KEYS;
	const size_t bytes = head_dim * run->kernels->number_bytes;
	const size_t parts[4] = {0, before, before + whole, rows};

	for (int i = 0; i < 3; i++) {
		const size_t from = parts[i] * head_dim, count = parts[i + 1] - parts[i];
		const size_t to = (base + first + parts[i]) * head_dim;
		void *to_k = dvsm_run_number(run, heads->keys, to);
		void *to_v = dvsm_run_number(run, heads->values, to);
		const void *from_k = dvsm_run_read(run, k, from);
		const void *from_v = dvsm_run_read(run, v, from);

		if (i == 1) {
			run->kernels->lay(from_k, from_v, count, head_dim, to_k, to_v);
		} else {
			memcpy(to_k, from_k, count * bytes);
			memcpy(to_v, from_v, count * bytes);
		}
	}
}

static bool wants_blocks(const struct dvsm_run *run)
{
	const struct dvsm_model_config *config = &run->model->config;

	return dvsm_kernels_want_blocks(run->kernels, config->dim / config->heads);
}

/* Keys and values of rows at .. at + rows - 1 to tokens `first` and on of heads. Of a block that
 * other tiles have a part of, the rows are there, but in rows. */
static void store_keys(const struct dvsm_run *run, const struct dvsm_tile *tile,
		       const struct dvsm_half_weights *weights, size_t at, size_t rows,
		       const struct dvsm_heads *heads, size_t first, uint32_t worker)
{
	const struct dvsm_model_config *config = &run->model->config;
	const size_t head_dim = config->dim / config->heads;
	void *k = dvsm_run_scratch(run, worker);
	void *v = dvsm_run_number(run, k, rows * head_dim);

	for (size_t h = 0; h < config->heads; h++) {
		size_t to = (h * heads->total + first) * head_dim;

		if (wants_blocks(run)) {
			finish_keys(run, tile, weights, at, rows, h, k, v);
			place_keys(run, k, v, rows, heads, h, first);
		} else {
			finish_keys(run, tile, weights, at, rows, h,
				    dvsm_run_number(run, heads->keys, to),
				    dvsm_run_number(run, heads->values, to));
		}
	}
}

static void project_queries(const struct dvsm_run *run, const struct dvsm_tile *tile,
			    const struct dvsm_half_weights *weights)
{
	dvsm_rows_product(run, normed(run, tile), tile->rows, &weights->query, wide(run, tile),
			  run->model->config.dim, DVSM_EPILOGUE_STORE);
}

/* x[count] less what bfloat16 makes of it. */
static void keep_rest(float *x, size_t count)
{
	for (size_t i = 0; i < count; i++)
		x[i] -= dvsm_bf16_widen(dvsm_bf16_round(x[i]));
}

/*
 * The same of rows that are not rounded first: the queries of what bfloat16 makes of them, and of
 * the rest. The rows wait where keys and values were.
 */
static void project_fine_queries(const struct dvsm_run *run, const struct dvsm_tile *tile,
				 const struct dvsm_half_weights *weights)
{
	const size_t dim = run->model->config.dim;
	float *rows = wide_keys(run, tile);

	run->kernels->embed_norm(residual(run, tile), tile->rows, dim, weights->norm,
				 (float)run->model->config.norm_eps, rows);
	run->kernels->left(rows, dim, tile->rows, dim, normed(run, tile), dim, 0);
	project_queries(run, tile, weights);
	keep_rest(rows, tile->rows * dim);
	run->kernels->left(rows, dim, tile->rows, dim, normed(run, tile), dim, 0);
	dvsm_rows_product(run, normed(run, tile), tile->rows, &weights->query, wide(run, tile), dim,
			  DVSM_EPILOGUE_ADD);
}

/* One head's attention for rows first .. first + rows - 1 of the tile, into its normed rows. */
static void attend_head(const struct dvsm_run *run, const struct dvsm_tile *tile,
			const struct dvsm_half_weights *weights, const struct dvsm_heads *heads,
			size_t head, size_t first, size_t rows, unsigned char *scratch)
{
	const struct dvsm_model_config *config = &run->model->config;
	const size_t dim = config->dim, head_dim = dim / config->heads;
	const size_t base = head * heads->total * head_dim;
	float *q = (float *)(void *)(scratch + dvsm_attention_scratch(head_dim));
	const struct dvsm_attention job = {
		.q = q,
		.q_stride = head_dim,
		.queries = rows,
		.k = dvsm_run_read(run, heads->keys, base),
		.v = dvsm_run_read(run, heads->values, base),
		.keys = heads->total,
		.head_dim = head_dim,
		.scale = 1.0f / sqrtf((float)head_dim),
		.out = dvsm_run_left(run, normed(run, tile), first, 0, dim),
		.out_stride = dim,
		.scratch = scratch,
		.out_col = head * head_dim,
		.bound = weights->score_bound,
	};

	run->kernels->query_norm(wide(run, tile) + first * dim + head * head_dim, dim, rows,
				 head_dim, weights->q_norm, (float)config->norm_eps, q, head_dim);
	run->kernels->attention(&job);
}

/* One head's attention of rows at .. at + rows - 1 of the tile, as many at a time as kernels take.
 */
static void attend_rows(const struct dvsm_run *run, const struct dvsm_tile *tile,
			const struct dvsm_half_weights *weights, const struct dvsm_heads *heads,
			size_t head, size_t at, size_t rows, uint32_t worker)
{
	const size_t most = run->kernels->attention_queries;

	for (size_t i = 0; i < dvsm_tiles(rows, most); i++)
		attend_head(run, tile, weights, heads, head, at + i * most,
			    dvsm_tile_length(rows, most, i), dvsm_run_scratch(run, worker));
}

static void attend_within_views(const struct block_job *job, const struct dvsm_tile *tile,
				uint32_t worker)
{
	const struct dvsm_half_weights *weights = &job->run->weights->blocks[job->layer].intra;
	struct dvsm_tile_part part;

	for (part = dvsm_tile_first_part(&job->cut, tile); part.rows > 0;
	     dvsm_tile_next_part(&job->cut, tile, &part)) {
		const struct dvsm_heads own = own_heads(job->run, part.view_row, part.view_tokens);

		for (size_t h = 0; h < job->run->model->config.heads; h++)
			attend_rows(job->run, tile, weights, &own, h, part.at, part.rows, worker);
	}
}

/* x += Wo normed; x += down(GELU(up(LN(x)))). */
static void mix(const struct dvsm_run *run, const struct dvsm_tile *tile,
		const struct dvsm_half_weights *weights)
{
	const size_t dim = run->model->config.dim;

	trace_rows(run, tile, weights, DVSM_TRACE_ATTENTION, normed(run, tile), dim);
	dvsm_rows_product(run, normed(run, tile), tile->rows, &weights->out, residual(run, tile),
			  dim, DVSM_EPILOGUE_ADD);
	norm(run, tile, weights->mlp_norm);
	dvsm_rows_product(run, normed(run, tile), tile->rows, &weights->up, wide(run, tile),
			  weights->up.out, DVSM_EPILOGUE_GELU);
	trace_rows(run, tile, weights, DVSM_TRACE_HIDDEN, wide(run, tile), weights->up.out);
	dvsm_rows_product(run, wide(run, tile), tile->rows, &weights->down, residual(run, tile),
			  dim, DVSM_EPILOGUE_ADD);
	trace_rows(run, tile, weights, DVSM_TRACE_OUTPUT, residual(run, tile), dim);
}

/* ---- parts of the layer ---- */

static void keys_task(void *context, size_t index, uint32_t worker)
{
	const struct block_job *job = context;
	const struct dvsm_half_weights *weights = &job->run->weights->blocks[job->layer].intra;
	const struct dvsm_tile tile = dvsm_cut_find(&job->cut, index);
	struct dvsm_tile_part part;

	norm(job->run, &tile, weights->norm);
	project_keys(job->run, &tile, weights);
	for (part = dvsm_tile_first_part(&job->cut, &tile); part.rows > 0;
	     dvsm_tile_next_part(&job->cut, &tile, &part)) {
		const struct dvsm_heads own = own_heads(job->run, part.view_row, part.view_tokens);

		store_keys(job->run, &tile, weights, part.at, part.rows, &own, part.first, worker);
	}
	project_queries(job->run, &tile, weights);
}

static void intra_task(void *context, size_t index, uint32_t worker)
{
	const struct block_job *job = context;
	const struct dvsm_block_weights *weights = &job->run->weights->blocks[job->layer];
	const struct dvsm_tile tile = dvsm_cut_find(&job->cut, index);

	attend_within_views(job, &tile, worker);
	mix(job->run, &tile, &weights->intra);
	norm(job->run, &tile, weights->cross.norm);
	project_keys(job->run, &tile, &weights->cross);
	store_keys(job->run, &tile, &weights->cross, 0, tile.rows, job->cache, tile.token, worker);
}

static void queries_task(void *context, size_t index, uint32_t worker)
{
	const struct block_job *job = context;
	const struct dvsm_half_weights *weights = &job->run->weights->blocks[job->layer].cross;
	const struct dvsm_tile tile = dvsm_cut_find(&job->cut, index);

	(void)worker;
	/* Here a ray finds its place in the other views: what is lost now is lost in all blocks. */
	if (job->layer == 0 && job->run->kernels->number_bytes < sizeof(float)) {
		project_fine_queries(job->run, &tile, weights);
		return;
	}
	norm(job->run, &tile, weights->norm);
	project_queries(job->run, &tile, weights);
}

/* Tasks that a head's attention across views is cut into: none where whole heads go round, so that
 * all tiles pass by its keys and values while a cache holds them. */
static size_t cuts_of_head(const struct block_job *job)
{
	const size_t threads = dvsm_pool_get_threads(job->run->pool);

	return job->run->model->config.heads % threads == 0 ? 1 : dvsm_cut_count(&job->cut);
}

static void heads_task(void *context, size_t index, uint32_t worker)
{
	const struct block_job *job = context;
	const struct dvsm_half_weights *weights = &job->run->weights->blocks[job->layer].cross;
	const size_t cuts = cuts_of_head(job);

	for (size_t i = index % cuts; i < dvsm_cut_count(&job->cut); i += cuts) {
		const struct dvsm_tile tile = dvsm_cut_find(&job->cut, i);

		attend_rows(job->run, &tile, weights, job->cache, index / cuts, 0, tile.rows,
			    worker);
	}
}

static void mix_task(void *context, size_t index, uint32_t worker)
{
	const struct block_job *job = context;
	const struct dvsm_tile tile = dvsm_cut_find(&job->cut, index);

	(void)worker;
	mix(job->run, &tile, &job->run->weights->blocks[job->layer].cross);
}

static void render_task(void *context, size_t index, uint32_t worker)
{
	const struct block_job *job = context;
	const struct dvsm_tile tile = dvsm_cut_find(&job->cut, index);

	attend_within_views(job, &tile, worker);
	mix(job->run, &tile, &job->run->weights->blocks[job->layer].intra);
	queries_task(context, index, worker);
}

/* The blocks of the cache that tiles have parts of: each once its last row is there. */
static void lay_borders(const struct block_job *job)
{
	const struct dvsm_run *run = job->run;
	const size_t heads = run->model->config.heads, head_dim = run->model->config.dim / heads;
	const size_t count = DVSM_BLOCK_KEYS * head_dim, bytes = count * run->kernels->number_bytes;
	unsigned char *rows = dvsm_run_scratch(run, 0);

	for (size_t i = 0; i < dvsm_cut_count(&job->cut); i++) {
		const struct dvsm_tile tile = dvsm_cut_find(&job->cut, i);
		const size_t first = tile.token / DVSM_BLOCK_KEYS * DVSM_BLOCK_KEYS;

		if (first == tile.token || first + DVSM_BLOCK_KEYS > tile.token + tile.rows)
			continue;
		for (size_t h = 0; h < heads; h++) {
			const size_t at = (h * job->cache->total + first) * head_dim;
			void *k = dvsm_run_number(run, job->cache->keys, at);
			void *v = dvsm_run_number(run, job->cache->values, at);

			memcpy(rows, k, bytes);
			memcpy(rows + bytes, v, bytes);
			run->kernels->lay(rows, rows + bytes, DVSM_BLOCK_KEYS, head_dim, k, v);
		}
	}
}

static struct block_job begin(const struct dvsm_run *run, uint32_t layer,
			      const struct dvsm_group *group, const struct dvsm_heads *cache)
{
	const size_t threads = dvsm_pool_get_threads(run->pool);

	return (struct block_job){run, dvsm_cut_make(group, threads, run->kernels->tiled), layer,
				  cache};
}

static void run_tiles(struct block_job *job, dvsm_task_fn *task)
{
	dvsm_pool_run(job->run->pool, dvsm_cut_count(&job->cut), task, job);
}

/* Attention across views for queries that are there, and what follows it. */
static void attend_across(struct block_job *job)
{
	const size_t heads = job->run->model->config.heads;

	dvsm_pool_run(job->run->pool, heads * cuts_of_head(job), heads_task, job);
	run_tiles(job, mix_task);
}

void dvsm_block_intra(const struct dvsm_run *run, uint32_t layer, const struct dvsm_group *group,
		      const struct dvsm_heads *cache)
{
	struct block_job job = begin(run, layer, group, cache);

	run_tiles(&job, keys_task);
	trace_own_heads(&job);
	run_tiles(&job, intra_task);
	if (wants_blocks(run))
		lay_borders(&job);
}

void dvsm_block_cross(const struct dvsm_run *run, uint32_t layer, const struct dvsm_group *group,
		      const struct dvsm_heads *cache)
{
	struct block_job job = begin(run, layer, group, cache);

	run_tiles(&job, queries_task);
	attend_across(&job);
}

void dvsm_block_render(const struct dvsm_run *run, uint32_t layer, const struct dvsm_group *group,
		       const struct dvsm_heads *cache)
{
	struct block_job job = begin(run, layer, group, cache);

	run_tiles(&job, keys_task);
	trace_own_heads(&job);
	run_tiles(&job, render_task);
	attend_across(&job);
}
