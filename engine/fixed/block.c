#include "fixed/block.h"

static void project_keys(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			 size_t tokens, int16_t *kv)
{
	dvsm_fixed_step_product(run, run->work.a, tokens, &half->key_value, kv, DVSM_FIXED_STORE,
				0);
	dvsm_fixed_step_keys(run, half, kv, tokens);
}

/* x += Wo attention(q of what work.a holds, layer); x += down(GELU(up(LN(x)))). */
static void attend_and_mix(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			   int32_t *x, size_t tokens, const struct dvsm_fixed_layer *layer)
{
	const struct dvsm_fixed_workspace *work = &run->work;
	const struct dvsm_model_config *config = run->config;
	struct dvsm_fixed_slots slots = work->slots;

	dvsm_fixed_slots_fill(run->model, half, config->dim, config->heads, layer->k_scale, &slots);

	dvsm_fixed_step_product(run, work->a, tokens, &half->query, work->wide, DVSM_FIXED_STORE,
				0);
	dvsm_fixed_step_queries(run, work->wide, tokens, &slots);
	dvsm_fixed_step_attention(run, tokens, layer);
	dvsm_fixed_step_quantise(run, work->mixed, tokens, config->dim, half->mixed_fraction);
	dvsm_fixed_step_product(run, work->a, tokens, &half->out, x, DVSM_FIXED_ADD, 0);

	dvsm_fixed_step_norm(run, x, tokens, &half->mlp_norm, false);
	dvsm_fixed_step_product(run, work->a, tokens, &half->up, work->wide, DVSM_FIXED_GELU,
				half->hidden_fraction);
	dvsm_fixed_step_quantise(run, work->wide, tokens, half->up.out, half->hidden_fraction);
	dvsm_fixed_step_product(run, work->a, tokens, &half->down, x, DVSM_FIXED_ADD, 0);
}

void dvsm_fixed_block_intra(const struct dvsm_fixed_run *run, uint32_t layer, int32_t *x,
			    size_t tokens, int16_t *kv)
{
	const struct dvsm_fixed_half *half = &run->model->blocks[layer].intra;
	struct dvsm_fixed_layer own = run->work.own;

	own.tokens = tokens;
	own.padded = dvsm_fixed_pad(tokens, DVSM_FIXED_KEY_PAD);
	dvsm_fixed_step_norm(run, x, tokens, &half->norm, false);
	project_keys(run, half, tokens, kv);
	dvsm_fixed_step_pack(run, half, kv, &own);
	attend_and_mix(run, half, x, tokens, &own);
}

void dvsm_fixed_block_cross_keys(const struct dvsm_fixed_run *run, uint32_t layer, const int32_t *x,
				 size_t tokens, int16_t *kv)
{
	const struct dvsm_fixed_half *half = &run->model->blocks[layer].cross;

	dvsm_fixed_step_norm(run, x, tokens, &half->norm, false);
	project_keys(run, half, tokens, kv);
}

void dvsm_fixed_block_cross(const struct dvsm_fixed_run *run, uint32_t layer, int32_t *x,
			    size_t tokens, const struct dvsm_fixed_layer *cache)
{
	const struct dvsm_fixed_half *half = &run->model->blocks[layer].cross;

	dvsm_fixed_step_norm(run, x, tokens, &half->norm, false);
	attend_and_mix(run, half, x, tokens, cache);
}
