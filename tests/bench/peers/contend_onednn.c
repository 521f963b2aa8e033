/* A composition of oneDNN primitives: what an engineer gets by calling the library op by op. */
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "onednn_steps.h"
#include "talk.h"

/* The head of the file that work.py writes; float32 arrays follow. */
struct head {
	uint32_t dim, heads, layers, patch, ratio, views, tokens;
	float eps;
};

struct half {
	const float *norm, *q_norm, *k_norm, *mlp_norm;
	struct matrix qkv, query, key_value, out, up, down;
};

struct model {
	struct head head;
	const float *at; /* the next number of the file */
	const float *context_ray, *context_rgb, *target_ray;
	struct matrix patch_ray, patch_rgb, to_rgb;
	const float *embed_norm, *final_norm;
	struct half *halves; /* intra and cross of each layer in turn */
};

struct contender {
	struct model model;
	struct plan *reconstruct, *render;
	struct array output;
	float *numbers;
};

static const float *take(struct model *model, size_t count)
{
	const float *at = model->at;

	model->at += count;
	return at;
}

static struct matrix take_matrix(struct model *model, size_t out, size_t in)
{
	return (struct matrix){take(model, out * in), out, in};
}

static struct half take_half(struct model *model)
{
	const size_t dim = model->head.dim, width = dim / model->head.heads;
	const size_t hidden = dim * model->head.ratio;
	struct half half = {.norm = take(model, dim)};

	half.qkv = take_matrix(model, 3 * dim, dim);
	half.query = (struct matrix){half.qkv.numbers, dim, dim};
	half.key_value = (struct matrix){half.qkv.numbers + dim * dim, 2 * dim, dim};
	half.q_norm = take(model, width);
	half.k_norm = take(model, width);
	half.out = take_matrix(model, dim, dim);
	half.mlp_norm = take(model, dim);
	half.up = take_matrix(model, hidden, dim);
	half.down = take_matrix(model, dim, hidden);
	return half;
}

static void read_model(const char *path, struct model *model)
{
	FILE *file = fopen(path, "rb");
	long bytes = file && fseek(file, 0, SEEK_END) == 0 ? ftell(file) : -1;
	float *numbers = bytes > 0 ? malloc((size_t)bytes) : NULL;
	const struct head *head = &model->head;
	size_t area, all;

	if (!numbers || fseek(file, 0, SEEK_SET) != 0 ||
	    fread(&model->head, sizeof model->head, 1, file) != 1)
		talk_fail("the work cannot be read");
	if (fread(numbers, 1, (size_t)bytes, file) + sizeof *head != (size_t)bytes)
		talk_fail("the work is cut short");
	fclose(file);
	model->at = numbers;
	area = (size_t)head->patch * head->patch;
	all = (size_t)head->views * head->tokens;
	model->context_ray = take(model, all * 6 * area);
	model->context_rgb = take(model, all * 3 * area);
	model->target_ray = take(model, head->tokens * 6 * area);
	model->patch_ray = take_matrix(model, head->dim, 6 * area);
	model->patch_rgb = take_matrix(model, head->dim, 3 * area);
	model->embed_norm = take(model, head->dim);
	model->halves = calloc(2 * (size_t)head->layers, sizeof *model->halves);
	if (!model->halves)
		talk_fail("no memory");
	for (uint32_t i = 0; i < 2 * head->layers; i++)
		model->halves[i] = take_half(model);
	model->final_norm = take(model, head->dim);
	model->to_rgb = take_matrix(model, 3 * area, head->dim);
	if ((size_t)((const char *)model->at - (const char *)numbers) + sizeof *head !=
	    (size_t)bytes)
		talk_fail("the work has another length than its sizes ask for");
}

/* Places that all layers of a stage use in turn. */
struct stage {
	struct plan *plan;
	const struct model *model;
	struct array x, normed, wide, hidden, mixed, q, k, v;
};

static struct stage make_stage(struct plan *plan, const struct model *model, size_t rows)
{
	const struct head *head = &model->head;
	const size_t width = head->dim / head->heads;

	return (struct stage){
		.plan = plan,
		.model = model,
		.x = plan_array(plan, rows, head->dim),
		.normed = plan_array(plan, rows, head->dim),
		.wide = plan_array(plan, rows, 3 * (size_t)head->dim),
		.hidden = plan_array(plan, rows, (size_t)head->ratio * head->dim),
		.mixed = plan_array(plan, rows, head->dim),
		.q = plan_array(plan, rows * head->heads, width),
		.k = plan_array(plan, rows * head->heads, width),
		.v = plan_array(plan, rows * head->heads, width),
	};
}

static void embed(struct stage *stage, const float *ray, const float *rgb)
{
	const struct model *model = stage->model;
	struct array in = plan_array(stage->plan, stage->x.rows, model->patch_ray.in);

	plan_fill(stage->plan, ray, in);
	plan_product(stage->plan, in, model->patch_ray, stage->mixed, AFTER_STORE);
	if (rgb) {
		in = plan_array(stage->plan, stage->x.rows, model->patch_rgb.in);
		plan_fill(stage->plan, rgb, in);
		plan_product(stage->plan, in, model->patch_rgb, stage->mixed, AFTER_ADD);
	}
	plan_norm(stage->plan, stage->mixed, model->embed_norm, model->head.eps, stage->x);
}

static void mix(struct stage *stage, const struct half *half, struct array k, struct array v,
		size_t batch)
{
	struct plan *plan = stage->plan;

	plan_attention(plan, stage->q, k, v, stage->model->head.heads, batch, stage->mixed);
	plan_product(plan, stage->mixed, half->out, stage->x, AFTER_ADD);
	plan_norm(plan, stage->x, half->mlp_norm, stage->model->head.eps, stage->normed);
	plan_product(plan, stage->normed, half->up, stage->hidden, AFTER_GELU);
	plan_product(plan, stage->hidden, half->down, stage->x, AFTER_ADD);
}

static void within(struct stage *stage, const struct half *half, size_t batch)
{
	const struct head *head = &stage->model->head;
	const size_t dim = head->dim;
	struct plan *plan = stage->plan;

	plan_norm(plan, stage->x, half->norm, head->eps, stage->normed);
	plan_product(plan, stage->normed, half->qkv, stage->wide, AFTER_STORE);
	plan_split(plan, stage->wide, 0, head->heads, batch, half->q_norm, head->eps, stage->q);
	plan_split(plan, stage->wide, dim, head->heads, batch, half->k_norm, head->eps, stage->k);
	plan_split(plan, stage->wide, 2 * dim, head->heads, batch, NULL, 0, stage->v);
	mix(stage, half, stage->k, stage->v, batch);
}

/* Queries of the cross-view layer from what `normed` holds. */
static void query(struct stage *stage, const struct half *half)
{
	const struct head *head = &stage->model->head;
	struct array narrow = {stage->wide.numbers, stage->wide.rows, head->dim};

	plan_product(stage->plan, stage->normed, half->query, narrow, AFTER_STORE);
	plan_split(stage->plan, narrow, 0, head->heads, 1, half->q_norm, head->eps, stage->q);
}

static void plan_reconstruct(struct contender *self, struct array *keys, struct array *values)
{
	const struct model *model = &self->model;
	const struct head *head = &model->head;
	struct stage stage =
		make_stage(self->reconstruct, model, (size_t)head->views * head->tokens);
	struct plan *plan = stage.plan;

	embed(&stage, model->context_ray, model->context_rgb);
	for (uint32_t i = 0; i < head->layers; i++) {
		const struct half *half = &model->halves[2 * i + 1];
		struct array pair = {stage.wide.numbers, stage.wide.rows, 2 * (size_t)head->dim};

		within(&stage, half - 1, head->views);
		keys[i] = plan_array(plan, stage.k.rows, stage.k.columns);
		values[i] = plan_array(plan, stage.k.rows, stage.k.columns);
		plan_norm(plan, stage.x, half->norm, head->eps, stage.normed);
		plan_product(plan, stage.normed, half->key_value, pair, AFTER_STORE);
		plan_split(plan, pair, 0, head->heads, 1, half->k_norm, head->eps, keys[i]);
		plan_split(plan, pair, head->dim, head->heads, 1, NULL, 0, values[i]);
		if (i + 1 == head->layers)
			break;
		query(&stage, half);
		mix(&stage, half, keys[i], values[i], 1);
	}
}

static void plan_render(struct contender *self, const struct array *keys,
			const struct array *values)
{
	const struct model *model = &self->model;
	const struct head *head = &model->head;
	struct stage stage = make_stage(self->render, model, head->tokens);

	embed(&stage, model->target_ray, NULL);
	for (uint32_t i = 0; i < head->layers; i++) {
		const struct half *half = &model->halves[2 * i + 1];

		within(&stage, half - 1, 1);
		plan_norm(stage.plan, stage.x, half->norm, head->eps, stage.normed);
		query(&stage, half);
		mix(&stage, half, keys[i], values[i], 1);
	}
	plan_norm(stage.plan, stage.x, model->final_norm, head->eps, stage.normed);
	self->output = plan_array(stage.plan, head->tokens, model->to_rgb.out);
	plan_product(stage.plan, stage.normed, model->to_rgb, self->output, AFTER_STORE);
}

static void reconstruct(void *context)
{
	plan_run(((struct contender *)context)->reconstruct);
}

static void render(void *context)
{
	struct contender *self = context;

	plan_run(self->render);
	plan_fetch(self->render, self->output, self->numbers);
}

static enum mode find_mode(const char *name)
{
	static const char *const NAMES[] = {"f32", "bf16", "int8"};

	for (int i = 0; i < 3; i++)
		if (strcmp(name, NAMES[i]) == 0)
			return (enum mode)i;
	talk_fail("a precision is f32, bf16 or int8");
}

int main(int argc, char **argv)
{
	static struct contender self;

	if (argc != 4)
		talk_fail("usage: contend_onednn WORK PRECISION THREADS");
	omp_set_num_threads((int)strtol(argv[3], NULL, 10));
	read_model(argv[1], &self.model);
	self.reconstruct = plan_create(find_mode(argv[2]));
	self.render = plan_create(find_mode(argv[2]));

	const size_t layers = self.model.head.layers;
	struct array *keys = calloc(layers, sizeof *keys), *values = calloc(layers, sizeof *values);

	if (!keys || !values)
		talk_fail("no memory");
	plan_reconstruct(&self, keys, values);
	plan_render(&self, keys, values);

	const size_t count = self.output.rows * self.output.columns;
	const struct talk talk = {&self, reconstruct, render,
				  self.numbers = calloc(count, sizeof(float)), count};
	const dnnl_version_t *version = dnnl_version();
	char about[64];

	if (!self.numbers)
		talk_fail("no memory");
	snprintf(about, sizeof about, "oneDNN %d.%d.%d", version->major, version->minor,
		 version->patch);
	talk_serve(about, &talk);
	free(keys);
	free(values);
	return 0;
}
