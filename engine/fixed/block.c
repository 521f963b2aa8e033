#include "fixed/block.h"

/* ---- what a trace is told ---- */

/* Which half block this is: 2 layer, plus 1 for the cross-view half. */
static size_t index_of(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half)
{
	const char *first = (const char *)run->model->blocks;

	return (size_t)((const char *)half - first) / sizeof(*half);
}

/* Which token's row of the residual stream this is. */
static size_t token_of(const struct dvsm_fixed_run *run, const int32_t *x)
{
	return (size_t)(x - run->work.x) / run->config->dim;
}

/* ---- steps ---- */

static struct dvsm_fixed_product key_product(const struct dvsm_fixed_run *run,
					     const struct dvsm_fixed_half *half, int16_t *kv)
{
	return (struct dvsm_fixed_product){
		.a = run->work.a,
		.w = &half->key_value,
		.c = kv,
		.epilogue = DVSM_FIXED_STORE,
		.then = {.what = DVSM_FIXED_KEYS_16, .half = half, .kv = kv},
	};
}

static struct dvsm_fixed_product query_product(const struct dvsm_fixed_run *run,
					       const struct dvsm_fixed_half *half)
{
	return (struct dvsm_fixed_product){
		.a = run->work.a,
		.w = &half->query,
		.c = run->work.wide,
		.epilogue = DVSM_FIXED_STORE,
	};
}

static struct dvsm_fixed_then norm_then(const int32_t *x, const struct dvsm_fixed_gain *gain,
					const struct dvsm_fixed_matrix *input)
{
	return (struct dvsm_fixed_then){
		.what = DVSM_FIXED_NORM, .x = x, .gain = gain, .input = input};
}

/* x += down(GELU(up(what work.a holds))) */
static void run_mlp(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
		    int32_t *x, size_t tokens, struct dvsm_fixed_then next)
{
	const struct dvsm_fixed_workspace *work = &run->work;
	/* Rows of the hidden numbers are longer than those that the others still read. */
	const struct dvsm_fixed_product up = {
		.a = work->a,
		.w = &half->up,
		.c = work->wide,
		.epilogue = DVSM_FIXED_GELU,
		.fraction = half->hidden_fraction,
		.then = {.what = DVSM_FIXED_QUANTISE,
			 .wide = work->wide,
			 .to = work->a_low,
			 .input = &half->down,
			 .fraction = half->hidden_fraction},
	};
	const struct dvsm_fixed_product down = {
		.a = work->a_low,
		.w = &half->down,
		.c = x,
		.epilogue = DVSM_FIXED_ADD,
		.then = next,
	};

	dvsm_fixed_step_products(run, tokens, &up, 1);
	if (run->trace)
		dvsm_trace_narrow(run->trace, index_of(run, half), DVSM_TRACE_HIDDEN,
				  token_of(run, x), work->wide, tokens, half->up.out,
				  half->hidden_fraction, 0);
	dvsm_fixed_step_products(run, tokens, &down, 1);
	if (run->trace)
		dvsm_trace_stream(run->trace, index_of(run, half), token_of(run, x), x, tokens,
				  run->model->fraction);
}

/* x += Wo attention(queries in work.wide, layers); then the MLP. */
static void attend_and_mix(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			   int32_t *x, size_t tokens, const struct dvsm_fixed_layers *layers,
			   struct dvsm_fixed_then next)
{
	const struct dvsm_fixed_workspace *work = &run->work;
	const struct dvsm_fixed_then quantise = {
		.what = DVSM_FIXED_QUANTISE,
		.wide = work->mixed,
		.to = work->a,
		.input = &half->out,
		.fraction = half->mixed_fraction,
	};
	const struct dvsm_fixed_product out = {
		.a = work->a,
		.w = &half->out,
		.c = x,
		.epilogue = DVSM_FIXED_ADD,
		.then = norm_then(x, &half->mlp_norm, &half->up),
	};

	dvsm_fixed_step_attention(run, half, work->wide, tokens, layers, quantise);
	if (run->trace)
		dvsm_trace_narrow(run->trace, index_of(run, half), DVSM_TRACE_ATTENTION,
				  token_of(run, x), work->mixed, tokens, run->config->dim,
				  half->mixed_fraction, run->config->dim / run->config->heads);
	dvsm_fixed_step_products(run, tokens, &out, 1);
	run_mlp(run, half, x, tokens, next);
}

static int16_t *group_kv(const struct dvsm_fixed_run *run, const struct dvsm_group *group)
{
	return run->work.kv + group->first_token[0] * 2 * run->config->dim;
}

static void trace_own_keys(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			   const struct dvsm_group *group)
{
	const size_t stride = 2 * (size_t)run->config->dim;

	for (uint32_t v = 0; run->trace && v < group->views; v++) {
		size_t first = group->first_token[v];

		dvsm_trace_packed(run->trace, index_of(run, half), first,
				  run->work.kv + first * stride, dvsm_group_tokens(group, v),
				  run->work.channels + v * stride, half->value_fraction);
	}
}

void dvsm_fixed_block_intra(const struct dvsm_fixed_run *run, uint32_t layer,
			    const struct dvsm_group *group, const struct dvsm_fixed_matrix *input)
{
	const struct dvsm_fixed_block *block = &run->model->blocks[layer];
	const struct dvsm_fixed_half *half = &block->intra;
	const size_t tokens = dvsm_fixed_group_rows(group);
	const struct dvsm_fixed_layers own = {.group = group};
	int32_t *x = dvsm_fixed_group_x(run, group);
	int16_t *kv = group_kv(run, group);
	const struct dvsm_fixed_product products[2] = {key_product(run, half, kv),
						       query_product(run, half)};

	dvsm_fixed_step_products(run, tokens, products, 2);
	dvsm_fixed_step_pack(run, half, kv, &own);
	trace_own_keys(run, half, group);
	attend_and_mix(run, half, x, tokens, &own, norm_then(x, &block->cross.norm, input));
}

void dvsm_fixed_block_cross_keys(const struct dvsm_fixed_run *run, uint32_t layer,
				 const struct dvsm_group *group)
{
	const struct dvsm_fixed_product product =
		key_product(run, &run->model->blocks[layer].cross, group_kv(run, group));

	dvsm_fixed_step_products(run, dvsm_fixed_group_rows(group), &product, 1);
}

void dvsm_fixed_block_cross(const struct dvsm_fixed_run *run, uint32_t layer,
			    const struct dvsm_group *group, const struct dvsm_fixed_layer *cache,
			    const struct dvsm_fixed_half *next)
{
	const struct dvsm_fixed_half *half = &run->model->blocks[layer].cross;
	const struct dvsm_fixed_product product = query_product(run, half);
	const struct dvsm_fixed_layers all = {.one = *cache};
	const size_t tokens = dvsm_fixed_group_rows(group);
	int32_t *x = dvsm_fixed_group_x(run, group);
	struct dvsm_fixed_then then = {.what = DVSM_FIXED_NOTHING};

	if (next)
		then = norm_then(x, &next->norm, &next->key_value);
	dvsm_fixed_step_products(run, tokens, &product, 1);
	attend_and_mix(run, half, x, tokens, &all, then);
}
