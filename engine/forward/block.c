#include "forward/block.h"

static void project_keys(const struct dvsm_run *run, const struct dvsm_half_weights *weights,
			 size_t tokens, const struct dvsm_heads *heads, size_t first)
{
	float *kv = run->work.wide;
	size_t width = weights->key_value.out;

	dvsm_step_product(run, run->work.normed, tokens, &weights->key_value, kv, width,
			  DVSM_EPILOGUE_STORE);
	dvsm_step_keys(run, kv, width, tokens, weights->k_norm, heads, first);
}

/* x += Wo attention(q of what work.normed holds, heads); x += down(GELU(up(LN(x)))). */
static void attend_and_mix(const struct dvsm_run *run, const struct dvsm_half_weights *weights,
			   float *x, size_t tokens, const struct dvsm_heads *heads)
{
	const struct dvsm_workspace *work = &run->work;
	const size_t dim = run->model->config.dim, hidden = weights->up.out;

	dvsm_step_product(run, work->normed, tokens, &weights->query, work->wide, dim,
			  DVSM_EPILOGUE_STORE);
	dvsm_step_attention(run, work->wide, dim, tokens, weights->q_norm, weights->score_bound,
			    heads, work->normed);
	dvsm_step_product(run, work->normed, tokens, &weights->out, x, dim, DVSM_EPILOGUE_ADD);

	dvsm_step_norm(run, x, tokens, weights->mlp_norm, work->normed);
	dvsm_step_product(run, work->normed, tokens, &weights->up, work->wide, hidden,
			  DVSM_EPILOGUE_GELU);
	dvsm_step_product(run, work->wide, tokens, &weights->down, x, dim, DVSM_EPILOGUE_ADD);
}

void dvsm_block_intra(const struct dvsm_run *run, uint32_t layer, float *x, size_t tokens)
{
	const struct dvsm_half_weights *weights = &run->weights->blocks[layer].intra;
	const struct dvsm_heads own = {run->work.keys, run->work.values, tokens};

	dvsm_step_norm(run, x, tokens, weights->norm, run->work.normed);
	project_keys(run, weights, tokens, &own, 0);
	attend_and_mix(run, weights, x, tokens, &own);
}

void dvsm_block_cross_keys(const struct dvsm_run *run, uint32_t layer, const float *x,
			   size_t tokens, const struct dvsm_heads *heads, size_t first)
{
	const struct dvsm_half_weights *weights = &run->weights->blocks[layer].cross;

	dvsm_step_norm(run, x, tokens, weights->norm, run->work.normed);
	project_keys(run, weights, tokens, heads, first);
}

void dvsm_block_cross(const struct dvsm_run *run, uint32_t layer, float *x, size_t tokens,
		      const struct dvsm_heads *heads)
{
	const struct dvsm_half_weights *weights = &run->weights->blocks[layer].cross;

	dvsm_step_norm(run, x, tokens, weights->norm, run->work.normed);
	attend_and_mix(run, weights, x, tokens, heads);
}
