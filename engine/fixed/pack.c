#include <string.h>

#include "fixed/run.h"

struct dvsm_fixed_layer dvsm_fixed_layers_get(const struct dvsm_fixed_run *run,
					      const struct dvsm_fixed_layers *layers, uint32_t view)
{
	const struct dvsm_fixed_workspace *work = &run->work;
	const size_t dim = run->config->dim, heads = run->config->heads;
	size_t padded = 0, before = 0;
	size_t tokens = 0;

	if (!layers->group)
		return layers->one;
	for (uint32_t v = 0; v <= view; v++) {
		tokens = dvsm_group_tokens(layers->group, v);
		before += padded;
		padded = dvsm_fixed_pad(tokens, DVSM_FIXED_KEY_PAD);
	}

	const size_t at = heads * dvsm_fixed_head_bytes(before, dim, heads);

	return (struct dvsm_fixed_layer){
		.tokens = tokens,
		.padded = padded,
		.keys = work->own_keys + at,
		.values = work->own_values + at,
		.k_scale = work->scales.k_scale + view * dim,
		.v_scale = work->scales.v_scale + view * dim,
		.v_mean = work->scales.v_mean + view * dim,
	};
}

struct pack_job {
	const struct dvsm_fixed_run *run;
	const struct dvsm_fixed_half *half;
	const int16_t *kv;
	const struct dvsm_fixed_layers *layers;
};

/* Keys and values of one layer, before packing and behind it. */
struct unpacked {
	const int16_t *kv;
	struct dvsm_fixed_layer layer;
	struct dvsm_fixed_range *ranges;
	struct dvsm_fixed_channel *channels;
};

static struct unpacked find_unpacked(const struct pack_job *job, uint32_t view)
{
	const struct dvsm_group *group = job->layers->group;
	const size_t stride = 2 * (size_t)job->run->config->dim;
	const size_t first = group ? group->first_token[view] - group->first_token[0] : 0;

	return (struct unpacked){
		.kv = job->kv + first * stride,
		.layer = dvsm_fixed_layers_get(job->run, job->layers, view),
		.ranges = job->run->work.ranges + view * stride,
		.channels = job->run->work.channels + view * stride,
	};
}

/* Ranges of a head's keys and values, and how they are packed. */
static void scale_head(const struct pack_job *job, const struct unpacked *from, size_t head,
		       size_t dim)
{
	const struct dvsm_fixed_run *run = job->run;
	const size_t first = head * dim, stride = 2 * (size_t)run->config->dim;
	struct dvsm_fixed_range *ranges = from->ranges + 2 * first;
	struct dvsm_fixed_half half = *job->half;
	struct dvsm_fixed_layer layer = from->layer;

	for (size_t d = 0; d < 2 * dim; d++)
		ranges[d] = (struct dvsm_fixed_range){0, INT16_MAX, INT16_MIN};
	run->kernels->range(from->kv + first, stride, layer.tokens, dim, ranges);
	run->kernels->range(from->kv + run->config->dim + first, stride, layer.tokens, dim,
			    ranges + dim);
	half.value_fraction += first;
	layer.k_scale += first;
	layer.v_scale += first;
	layer.v_mean += first;
	dvsm_fixed_layer_scale(&half, dim, ranges, &layer, from->channels + 2 * first);
}

/* One head from its ranges to its packed keys and values: nothing is left to be put together. */
static void pack_task(void *context, size_t index, uint32_t worker)
{
	const struct pack_job *job = context;
	const struct dvsm_model_config *config = job->run->config;
	const size_t head = index % config->heads, dim = config->dim / config->heads;
	const struct unpacked from = find_unpacked(job, (uint32_t)(index / config->heads));
	const struct dvsm_fixed_layer *layer = &from.layer;
	const size_t bytes = dvsm_fixed_head_bytes(layer->padded, config->dim, config->heads);
	const struct dvsm_fixed_channel *channels = from.channels + 2 * head * dim;
	struct dvsm_fixed_pack pack = {
		.x = from.kv + head * dim,
		.x_stride = 2 * (size_t)config->dim,
		.rows = layer->tokens,
		.dim = dim,
		.head_width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD),
		.channels = channels,
		.packed = layer->keys + head * bytes,
	};

	(void)worker;
	scale_head(job, &from, head, dim);
	if (layer->tokens < layer->padded || dim < pack.head_width) {
		memset(layer->keys + head * bytes, 0, bytes);
		memset(layer->values + head * bytes, 0, bytes);
	}
	job->run->kernels->pack_keys(&pack);
	pack.x += config->dim;
	pack.channels = channels + dim;
	pack.packed = layer->values + head * bytes;
	job->run->kernels->pack_values(&pack);
	if (layer->fine_keys)
		dvsm_fixed_layer_refine(layer, head, dim);
}

void dvsm_fixed_step_pack(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			  const int16_t *kv, const struct dvsm_fixed_layers *layers)
{
	struct pack_job job = {run, half, kv, layers};
	const size_t count = layers->group ? layers->group->views : 1;

	dvsm_pool_run(run->pool, count * run->config->heads, pack_task, &job);
}
