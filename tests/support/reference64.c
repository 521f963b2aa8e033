#include "support/reference64.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "support/reference64_model.h"
#include "support/reference64_picture.h"

/* Keys and values of some tokens, [heads][tokens][D/heads] each. */
struct heads {
	size_t tokens;
	double *keys, *values;
};

struct support_reference_scene {
	struct reference_frame frame;
	uint32_t layers;
	size_t tokens;
	struct heads *cache; /* [layers] */
};

static double *allocate(size_t rows, size_t columns)
{
	return support_reference_allocate(rows * columns, sizeof(double));
}

/* c[columns] = a[depth] b[depth][columns] */
static void multiply_row(const double *a, const double *b, size_t depth, size_t columns, double *c)
{
	memset(c, 0, columns * sizeof(c[0]));
	for (size_t k = 0; k < depth; k++) {
		for (size_t j = 0; j < columns; j++)
			c[j] += a[k] * b[k * columns + j];
	}
}

/* x[rows][in] W^T; release with free(). */
static double *linear(const struct reference_matrix *w, const double *x, size_t rows)
{
	double *y = allocate(rows, w->out);

	for (size_t i = 0; i < rows; i++)
		multiply_row(x + i * w->in, w->numbers, w->in, w->out, y + i * w->out);
	return y;
}

static void add(double *x, const double *y, size_t count)
{
	for (size_t i = 0; i < count; i++)
		x[i] += y[i];
}

static void widen(double *largest, const double *x, size_t count)
{
	for (size_t i = 0; i < count; i++)
		*largest = fmax(*largest, fabs(x[i]));
}

static double mean_square(const double *x, size_t dim, double mean)
{
	double sum = 0;

	for (size_t i = 0; i < dim; i++)
		sum += (x[i] - mean) * (x[i] - mean);
	return sum / (double)dim;
}

static void layer_norm(const double *x, size_t rows, size_t dim, const double *weight, double eps,
		       double *out)
{
	for (size_t row = 0; row < rows; row++, x += dim, out += dim) {
		double sum = 0;

		for (size_t i = 0; i < dim; i++)
			sum += x[i];

		double mean = sum / (double)dim;
		double size = sqrt(mean_square(x, dim, mean) + eps);

		for (size_t i = 0; i < dim; i++)
			out[i] = (x[i] - mean) / size * weight[i];
	}
}

static double *normed(const double *x, size_t rows, size_t dim, const double *weight, double eps)
{
	double *out = allocate(rows, dim);

	layer_norm(x, rows, dim, weight, eps, out);
	return out;
}

static void rms_norm(const double *x, size_t dim, const double *weight, double eps, double *out)
{
	double size = sqrt(mean_square(x, dim, 0) + eps);

	for (size_t i = 0; i < dim; i++)
		out[i] = x[i] / size * weight[i];
}

static double gelu(double x)
{
	/* x Phi(x): erfc keeps the digits of the tail where 1 + erf would lose them. */
	return 0.5 * x * erfc(-x / sqrt(2));
}

static void softmax(double *scores, size_t count)
{
	double top = scores[0], sum = 0;

	for (size_t i = 1; i < count; i++)
		top = fmax(top, scores[i]);
	for (size_t i = 0; i < count; i++) {
		scores[i] = exp(scores[i] - top);
		sum += scores[i];
	}
	for (size_t i = 0; i < count; i++)
		scores[i] /= sum;
}

/* One part of qkv[tokens][3 D] as [heads][all tokens][D/heads], from token `first` on; the norm is
 * left out where its weight is NULL. */
static void split_heads(const struct dvsm_model_config *config, const double *part, size_t tokens,
			const double *norm, double *out, size_t all, size_t first)
{
	const size_t dim = config->dim, head_dim = dim / config->heads;

	for (size_t head = 0; head < config->heads; head++) {
		for (size_t i = 0; i < tokens; i++) {
			const double *from = part + i * 3 * dim + head * head_dim;
			double *to = out + (head * all + first + i) * head_dim;

			if (norm)
				rms_norm(from, head_dim, norm, config->norm_eps, to);
			else
				memcpy(to, from, head_dim * sizeof(to[0]));
		}
	}
}

static struct heads make_heads(const struct dvsm_model_config *config, size_t tokens)
{
	return (struct heads){tokens, allocate(tokens, config->dim), allocate(tokens, config->dim)};
}

static void free_heads(struct heads *heads)
{
	free(heads->keys);
	free(heads->values);
}

/* One head: out[tokens], rows D apart, from queries[tokens][D/heads] and its keys and values. */
static void attend(const double *queries, size_t tokens, const double *keys, const double *values,
		   size_t count, size_t head_dim, double *out, size_t dim, double *largest_score)
{
	double *keys_t = allocate(head_dim, count), *scores = allocate(1, count);

	for (size_t j = 0; j < count; j++) {
		for (size_t d = 0; d < head_dim; d++)
			keys_t[d * count + j] = keys[j * head_dim + d];
	}
	for (size_t i = 0; i < tokens; i++) {
		multiply_row(queries + i * head_dim, keys_t, head_dim, count, scores);
		for (size_t j = 0; j < count; j++)
			scores[j] /= sqrt((double)head_dim);
		widen(largest_score, scores, count);
		softmax(scores, count);
		multiply_row(scores, values, count, head_dim, out + i * dim);
	}
	free(keys_t);
	free(scores);
}

/* x += Wo attention(queries of x, heads); x += down(GELU(up(LN(x)))). */
static void attend_and_mix(const struct support_reference *reference,
			   const struct reference_half *half, double *x, size_t tokens,
			   const double *qkv, const struct heads *heads)
{
	const struct dvsm_model_config *config = &reference->config;
	const size_t dim = config->dim, head_dim = dim / config->heads;
	double *queries = allocate(tokens, dim), *mixed = allocate(tokens, dim), *y, *hidden;

	split_heads(config, qkv, tokens, half->q_norm, queries, tokens, 0);
	for (size_t head = 0; head < config->heads; head++)
		attend(queries + head * tokens * head_dim, tokens,
		       heads->keys + head * heads->tokens * head_dim,
		       heads->values + head * heads->tokens * head_dim, heads->tokens, head_dim,
		       mixed + head * head_dim, dim, &reference->range->score);
	y = linear(&half->out, mixed, tokens);
	add(x, y, tokens * dim);
	free(y);
	free(queries);
	free(mixed);

	y = normed(x, tokens, dim, half->mlp_norm, config->norm_eps);
	hidden = linear(&half->up, y, tokens);
	free(y);
	for (size_t i = 0; i < tokens * half->up.out; i++)
		hidden[i] = gelu(hidden[i]);
	y = linear(&half->down, hidden, tokens);
	add(x, y, tokens * dim);
	widen(&reference->range->residual, x, tokens * dim);
	free(y);
	free(hidden);
}

/* q, k and v of LN(x), [tokens][3 D]. */
static double *project(const struct support_reference *reference, const struct reference_half *half,
		       const double *x, size_t tokens)
{
	const struct dvsm_model_config *config = &reference->config;
	double *y = normed(x, tokens, config->dim, half->norm, config->norm_eps);
	double *qkv = linear(&half->qkv, y, tokens);

	free(y);
	return qkv;
}

static void fill_heads(const struct support_reference *reference, const struct reference_half *half,
		       const double *qkv, size_t tokens, struct heads *heads)
{
	const size_t dim = reference->config.dim;

	split_heads(&reference->config, qkv + dim, tokens, half->k_norm, heads->keys, heads->tokens,
		    0);
	split_heads(&reference->config, qkv + 2 * dim, tokens, NULL, heads->values, heads->tokens,
		    0);
}

static void intra_view(const struct support_reference *reference, uint32_t layer, double *x,
		       size_t tokens)
{
	const struct reference_half *half = &reference->blocks[layer][REFERENCE_INTRA];
	struct heads own = make_heads(&reference->config, tokens);
	double *qkv = project(reference, half, x, tokens);

	fill_heads(reference, half, qkv, tokens, &own);
	attend_and_mix(reference, half, x, tokens, qkv, &own);
	free(qkv);
	free_heads(&own);
}

/* x[tokens][D] = LN(W_ray rays [+ W_rgb (2 rgb - 1)]) */
static void embed(const struct support_reference *reference, const struct reference_frame *frame,
		  const struct dvsm_view *view, struct reference_grid grid, double *x)
{
	const struct dvsm_model_config *config = &reference->config;
	const size_t tokens = grid.across * grid.down;
	double *patches = reference_rays(&view->camera, frame, grid, config->patch_px);
	double *rays = linear(&reference->patch_ray, patches, tokens);

	free(patches);
	if (view->rgb) {
		patches = reference_colours(view, grid, config->patch_px);

		double *colours = linear(&reference->patch_rgb, patches, tokens);

		add(rays, colours, tokens * config->dim);
		free(colours);
		free(patches);
	}
	layer_norm(rays, tokens, config->dim, reference->embed_norm, config->norm_eps, x);
	free(rays);
}

struct support_reference_scene *
support_reference_reconstruct(const struct support_reference *reference,
			      const struct dvsm_view *views, uint32_t count, uint32_t patch_px)
{
	const struct dvsm_model_config *config = &reference->config;
	const size_t dim = config->dim;
	struct support_reference_scene *scene = support_reference_allocate(1, sizeof(*scene));
	size_t *first = support_reference_allocate(count + 1, sizeof(*first));

	patch_px = patch_px ? patch_px : config->patch_px;
	scene->frame = reference_frame_of(views, count);
	scene->layers = config->layers;
	scene->cache = support_reference_allocate(config->layers, sizeof(scene->cache[0]));
	for (uint32_t v = 0; v < count; v++) {
		struct reference_grid grid = reference_grid_of(&views[v].camera, patch_px);

		first[v + 1] = first[v] + grid.across * grid.down;
	}
	scene->tokens = first[count];

	double *x = allocate(scene->tokens, dim);

	for (uint32_t v = 0; v < count; v++)
		embed(reference, &scene->frame, &views[v],
		      reference_grid_of(&views[v].camera, patch_px), x + first[v] * dim);
	for (uint32_t layer = 0; layer < config->layers; layer++) {
		const struct reference_half *half = &reference->blocks[layer][REFERENCE_CROSS];

		for (uint32_t v = 0; v < count; v++)
			intra_view(reference, layer, x + first[v] * dim, first[v + 1] - first[v]);

		double *qkv = project(reference, half, x, scene->tokens);

		scene->cache[layer] = make_heads(config, scene->tokens);
		fill_heads(reference, half, qkv, scene->tokens, &scene->cache[layer]);
		if (layer + 1 < config->layers)
			attend_and_mix(reference, half, x, scene->tokens, qkv,
				       &scene->cache[layer]);
		free(qkv);
	}
	free(x);
	free(first);
	return scene;
}

void support_reference_scene_free(struct support_reference_scene *scene)
{
	if (!scene)
		return;
	for (uint32_t layer = 0; layer < scene->layers; layer++)
		free_heads(&scene->cache[layer]);
	free(scene->cache);
	free(scene);
}

size_t support_reference_scene_get_tokens(const struct support_reference_scene *scene)
{
	return scene->tokens;
}

const double *support_reference_scene_get_keys(const struct support_reference_scene *scene,
					       uint32_t layer)
{
	return scene->cache[layer].keys;
}

const double *support_reference_scene_get_values(const struct support_reference_scene *scene,
						 uint32_t layer)
{
	return scene->cache[layer].values;
}

void support_reference_render(const struct support_reference *reference,
			      const struct support_reference_scene *scene,
			      const struct dvsm_camera *camera, uint32_t patch_px, double *rgb)
{
	const struct dvsm_model_config *config = &reference->config;
	const struct dvsm_view target = {.camera = *camera};
	struct reference_grid grid =
		reference_grid_of(camera, patch_px ? patch_px : config->patch_px);
	const size_t tokens = grid.across * grid.down, dim = config->dim;
	double *x = allocate(tokens, dim), *y, *patches;

	embed(reference, &scene->frame, &target, grid, x);
	for (uint32_t layer = 0; layer < config->layers; layer++) {
		const struct reference_half *half = &reference->blocks[layer][REFERENCE_CROSS];

		intra_view(reference, layer, x, tokens);

		double *qkv = project(reference, half, x, tokens);

		attend_and_mix(reference, half, x, tokens, qkv, &scene->cache[layer]);
		free(qkv);
	}
	y = normed(x, tokens, dim, reference->final_norm, config->norm_eps);
	patches = linear(&reference->to_rgb, y, tokens);
	for (size_t i = 0; i < tokens * reference->to_rgb.out; i++)
		patches[i] =
			config->rgb_sigmoid ? 1 / (1 + exp(-patches[i])) : 0.5 + 0.5 * patches[i];
	reference_put_back(patches, grid, config->patch_px, camera, rgb);
	free(patches);
	free(x);
	free(y);
}
