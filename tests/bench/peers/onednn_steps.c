#include "onednn_steps.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "talk.h"

#if DNNL_VERSION_MAJOR != 2
#error "written for oneDNN 2 (Debian 12: libdnnl-dev)"
#endif

#define MAX_STEPS     512
#define MAX_ARGUMENTS 5

/* A primitive, or a loop of ours. */
struct step {
	dnnl_primitive_t primitive;
	dnnl_exec_arg_t arguments[MAX_ARGUMENTS];
	int argument_count;
	void (*loop)(const struct step *step);
	struct array from, to;
	size_t first, heads, batch;
	const float *weight;
	float eps;
	float *scales;           /* int8: where the product's scales go, [columns] */
	const float *row_scales; /* of the weights */
	size_t scale_count;
	bool half; /* numbers are bfloat16 */
};

struct plan {
	enum mode mode;
	dnnl_engine_t engine;
	dnnl_stream_t stream;
	struct step steps[MAX_STEPS];
	size_t count;
};

static void must(dnnl_status_t status)
{
	if (status != dnnl_success)
		talk_fail("oneDNN refuses a primitive");
}

static void *allocate(size_t bytes)
{
	void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);

	if (!memory)
		talk_fail("no memory");
	memset(memory, 0, bytes);
	return memory;
}

struct plan *plan_create(enum mode mode)
{
	struct plan *plan = allocate(sizeof *plan);

	plan->mode = mode;
	must(dnnl_engine_create(&plan->engine, dnnl_cpu, 0));
	must(dnnl_stream_create(&plan->stream, plan->engine, dnnl_stream_default_flags));
	return plan;
}

void plan_run(struct plan *plan)
{
	for (size_t i = 0; i < plan->count; i++) {
		const struct step *step = &plan->steps[i];

		if (step->loop)
			step->loop(step);
		else
			must(dnnl_primitive_execute(step->primitive, plan->stream,
						    step->argument_count, step->arguments));
	}
	must(dnnl_stream_wait(plan->stream));
}

static struct step *add(struct plan *plan)
{
	if (plan->count == MAX_STEPS)
		talk_fail("more layers than there is room for");
	plan->steps[plan->count] = (struct step){.half = plan->mode == MODE_BF16};
	return &plan->steps[plan->count++];
}

static dnnl_data_type_t moving_type(const struct plan *plan)
{
	return plan->mode == MODE_BF16 ? dnnl_bf16 : dnnl_f32;
}

static dnnl_memory_desc_t describe(int count, const dnnl_dim_t *sizes, dnnl_data_type_t type,
				   dnnl_format_tag_t tag)
{
	dnnl_memory_desc_t made;
	dnnl_dims_t all = {0}; /* the library takes a whole one, whatever the count */

	memcpy(all, sizes, (size_t)count * sizeof *sizes);
	must(dnnl_memory_desc_init_by_tag(&made, count, all, type, tag));
	return made;
}

static dnnl_memory_t wrap(const struct plan *plan, const dnnl_memory_desc_t *about, void *numbers)
{
	dnnl_memory_t memory;

	must(dnnl_memory_create(&memory, about, plan->engine, numbers));
	return memory;
}

static void argue(struct step *step, int name, dnnl_memory_t memory)
{
	step->arguments[step->argument_count++] = (dnnl_exec_arg_t){name, memory};
}

struct array plan_array(const struct plan *plan, size_t rows, size_t columns)
{
	const size_t width = plan->mode == MODE_BF16 ? 2 : 4;

	return (struct array){allocate(rows * columns * width), rows, columns};
}

/* Numbers of either type */

static float load(const void *numbers, size_t at, bool half)
{
	float value;

	if (!half)
		return ((const float *)numbers)[at];

	uint32_t bits = (uint32_t)((const uint16_t *)numbers)[at] << 16;

	memcpy(&value, &bits, sizeof value);
	return value;
}

static void store(void *numbers, size_t at, float value, bool half)
{
	uint32_t bits;

	if (!half) {
		((float *)numbers)[at] = value;
		return;
	}
	memcpy(&bits, &value, sizeof bits);
	bits += 0x7fff + (bits >> 16 & 1);
	((uint16_t *)numbers)[at] = (uint16_t)(bits >> 16);
}

void plan_fill(const struct plan *plan, const float *from, struct array to)
{
	for (size_t i = 0; i < to.rows * to.columns; i++)
		store(to.numbers, i, from[i], plan->mode == MODE_BF16);
}

void plan_fetch(const struct plan *plan, struct array from, float *to)
{
	for (size_t i = 0; i < from.rows * from.columns; i++)
		to[i] = load(from.numbers, i, plan->mode == MODE_BF16);
}

/* Products */

/* Weights quantised once, a scale a row; what oneDNN then packs. */
static int8_t *quantise_weights(struct matrix w, float *row_scales)
{
	int8_t *made = allocate(w.out * w.in);

	for (size_t row = 0; row < w.out; row++) {
		const float *numbers = w.numbers + row * w.in;
		float most = 1e-30f;

		for (size_t i = 0; i < w.in; i++)
			most = fmaxf(most, fabsf(numbers[i]));
		row_scales[row] = most / 127;
		for (size_t i = 0; i < w.in; i++)
			made[row * w.in + i] = (int8_t)lrintf(numbers[i] * 127 / most);
	}
	return made;
}

/* Activations by their largest number, and with it the scale of each column of the product. */
static void quantise(const struct step *step)
{
	const float *from = step->from.numbers;
	int8_t *to = step->to.numbers;
	const size_t count = step->from.rows * step->from.columns;
	float most = 1e-30f;

#pragma omp parallel for reduction(max : most)
	for (size_t i = 0; i < count; i++)
		most = fmaxf(most, fabsf(from[i]));

	const float factor = 127 / most;

#pragma omp parallel for
	for (size_t i = 0; i < count; i++)
		to[i] = (int8_t)rintf(from[i] * factor);
	for (size_t i = 0; i < step->scale_count; i++)
		step->scales[i] = step->row_scales[i] / factor;
}

static dnnl_memory_t pack(const struct plan *plan, const dnnl_memory_desc_t *plain,
			  const dnnl_memory_desc_t *wanted, void *numbers)
{
	dnnl_memory_t from = wrap(plan, plain, numbers);
	dnnl_memory_t to = wrap(plan, wanted, allocate(dnnl_memory_desc_get_size(wanted)));
	const dnnl_exec_arg_t arguments[] = {{DNNL_ARG_FROM, from}, {DNNL_ARG_TO, to}};
	dnnl_primitive_desc_t about;
	dnnl_primitive_t reorder;

	must(dnnl_reorder_primitive_desc_create(&about, plain, plan->engine, wanted, plan->engine,
						NULL));
	must(dnnl_primitive_create(&reorder, about));
	must(dnnl_primitive_execute(reorder, plan->stream, 2, arguments));
	must(dnnl_stream_wait(plan->stream));
	dnnl_primitive_destroy(reorder);
	dnnl_primitive_desc_destroy(about);
	dnnl_memory_destroy(from);
	return to;
}

static dnnl_primitive_attr_t make_attributes(const struct plan *plan, enum after after)
{
	dnnl_primitive_attr_t attributes;
	dnnl_post_ops_t more;

	must(dnnl_primitive_attr_create(&attributes));
	must(dnnl_post_ops_create(&more));
	if (plan->mode == MODE_INT8) {
		const float later = DNNL_RUNTIME_F32_VAL;

		must(dnnl_primitive_attr_set_output_scales(attributes, 1, 1 << 1, &later));
	}
	if (after == AFTER_ADD)
		must(dnnl_post_ops_append_sum(more, 1));
	if (after == AFTER_GELU)
		must(dnnl_post_ops_append_eltwise(more, 1, dnnl_eltwise_gelu_erf, 0, 0));
	must(dnnl_primitive_attr_set_post_ops(attributes, more));
	dnnl_post_ops_destroy(more);
	return attributes;
}

void plan_product(struct plan *plan, struct array a, struct matrix w, struct array c,
		  enum after after)
{
	const bool int8 = plan->mode == MODE_INT8;
	const dnnl_data_type_t factor = int8 ? dnnl_s8 : moving_type(plan);
	const dnnl_dim_t a_sizes[] = {(dnnl_dim_t)a.rows, (dnnl_dim_t)a.columns};
	const dnnl_dim_t w_sizes[] = {(dnnl_dim_t)w.in, (dnnl_dim_t)w.out};
	const dnnl_dim_t c_sizes[] = {(dnnl_dim_t)c.rows, (dnnl_dim_t)c.columns};
	const dnnl_dim_t scale_sizes[] = {(dnnl_dim_t)w.out};
	const dnnl_memory_desc_t a_about = describe(2, a_sizes, factor, dnnl_ab);
	const dnnl_memory_desc_t any = describe(2, w_sizes, factor, dnnl_format_tag_any);
	const dnnl_memory_desc_t plain = describe(2, w_sizes, int8 ? dnnl_s8 : dnnl_f32, dnnl_ba);
	const dnnl_memory_desc_t c_about = describe(2, c_sizes, moving_type(plan), dnnl_ab);
	const dnnl_memory_desc_t scales_about = describe(1, scale_sizes, dnnl_f32, dnnl_a);
	dnnl_primitive_attr_t attributes = make_attributes(plan, after);
	void *numbers = (void *)(uintptr_t)w.numbers;
	struct step *before = int8 ? add(plan) : NULL, *step = add(plan);
	dnnl_primitive_desc_t about;
	dnnl_matmul_desc_t matmul;

	if (before) {
		float *row_scales = allocate(w.out * sizeof(float));

		numbers = quantise_weights(w, row_scales);
		*before = (struct step){.loop = quantise,
					.from = a,
					.to = {allocate(a.rows * a.columns), a.rows, a.columns},
					.scales = allocate(w.out * sizeof(float)),
					.row_scales = row_scales,
					.scale_count = w.out};
		argue(step, DNNL_ARG_ATTR_OUTPUT_SCALES, wrap(plan, &scales_about, before->scales));
	}
	must(dnnl_matmul_desc_init(&matmul, &a_about, &any, NULL, &c_about));
	must(dnnl_primitive_desc_create(&about, &matmul, attributes, plan->engine, NULL));
	must(dnnl_primitive_create(&step->primitive, about));
	argue(step, DNNL_ARG_SRC, wrap(plan, &a_about, before ? before->to.numbers : a.numbers));
	argue(step, DNNL_ARG_WEIGHTS,
	      pack(plan, &plain, dnnl_primitive_desc_query_md(about, dnnl_query_weights_md, 0),
		   numbers));
	argue(step, DNNL_ARG_DST, wrap(plan, &c_about, c.numbers));
	dnnl_primitive_desc_destroy(about);
	dnnl_primitive_attr_destroy(attributes);
}

void plan_norm(struct plan *plan, struct array x, const float *weight, float eps, struct array out)
{
	const dnnl_dim_t sizes[] = {(dnnl_dim_t)x.rows, (dnnl_dim_t)x.columns};
	const dnnl_dim_t scale_sizes[] = {(dnnl_dim_t)x.columns};
	const dnnl_memory_desc_t data = describe(2, sizes, moving_type(plan), dnnl_ab);
	const dnnl_memory_desc_t scale = describe(1, scale_sizes, dnnl_f32, dnnl_a);
	struct step *step = add(plan);
	dnnl_layer_normalization_desc_t norm;
	dnnl_primitive_desc_t about;

	must(dnnl_layer_normalization_forward_desc_init(&norm, dnnl_forward_inference, &data, NULL,
							eps, dnnl_use_scale));
	must(dnnl_primitive_desc_create(&about, &norm, NULL, plan->engine, NULL));
	must(dnnl_primitive_create(&step->primitive, about));
	argue(step, DNNL_ARG_SRC, wrap(plan, &data, x.numbers));
	argue(step, DNNL_ARG_SCALE, wrap(plan, &scale, (void *)(uintptr_t)weight));
	argue(step, DNNL_ARG_DST, wrap(plan, &data, out.numbers));
	dnnl_primitive_desc_destroy(about);
}

/* Attention */

static void split_heads(const struct step *step)
{
	const size_t tokens = step->from.rows / step->batch;
	const size_t width = step->to.columns, pitch = step->from.columns;

#pragma omp parallel for collapse(2)
	for (size_t part = 0; part < step->batch; part++) {
		for (size_t head = 0; head < step->heads; head++) {
			for (size_t token = 0; token < tokens; token++) {
				const size_t at = (part * tokens + token) * pitch + step->first +
						  head * width;
				const size_t to =
					((part * step->heads + head) * tokens + token) * width;
				float square = 0, scale = 1;

				for (size_t i = 0; step->weight && i < width; i++) {
					float x = load(step->from.numbers, at + i, step->half);

					square += x * x;
				}
				if (step->weight)
					scale = 1 / sqrtf(square / (float)width + step->eps);
				for (size_t i = 0; i < width; i++)
					store(step->to.numbers, to + i,
					      load(step->from.numbers, at + i, step->half) * scale *
						      (step->weight ? step->weight[i] : 1),
					      step->half);
			}
		}
	}
}

void plan_split(struct plan *plan, struct array from, size_t first, size_t heads, size_t batch,
		const float *weight, float eps, struct array out)
{
	struct step *step = add(plan);

	step->loop = split_heads;
	step->from = from;
	step->to = out;
	step->first = first;
	step->heads = heads;
	step->batch = batch;
	step->weight = weight;
	step->eps = eps;
}

static void merge_heads(const struct step *step)
{
	const size_t tokens = step->to.rows / step->batch;
	const size_t width = step->from.columns, bytes = width * (step->half ? 2 : 4);
	const char *from = step->from.numbers;
	char *to = step->to.numbers;

#pragma omp parallel for collapse(2)
	for (size_t part = 0; part < step->batch; part++)
		for (size_t token = 0; token < tokens; token++)
			for (size_t head = 0; head < step->heads; head++)
				memcpy(to + ((part * tokens + token) * step->heads + head) * bytes,
				       from + ((part * step->heads + head) * tokens + token) *
						       bytes,
				       bytes);
}

static void add_batched(struct plan *plan, const dnnl_memory_desc_t *a, void *a_numbers,
			const dnnl_memory_desc_t *b, void *b_numbers, const dnnl_memory_desc_t *c,
			void *c_numbers, float scale)
{
	struct step *step = add(plan);
	dnnl_primitive_attr_t attributes;
	dnnl_primitive_desc_t about;
	dnnl_matmul_desc_t matmul;

	must(dnnl_primitive_attr_create(&attributes));
	must(dnnl_primitive_attr_set_output_scales(attributes, 1, 0, &scale));
	must(dnnl_matmul_desc_init(&matmul, a, b, NULL, c));
	must(dnnl_primitive_desc_create(&about, &matmul, attributes, plan->engine, NULL));
	must(dnnl_primitive_create(&step->primitive, about));
	argue(step, DNNL_ARG_SRC, wrap(plan, a, a_numbers));
	argue(step, DNNL_ARG_WEIGHTS, wrap(plan, b, b_numbers));
	argue(step, DNNL_ARG_DST, wrap(plan, c, c_numbers));
	dnnl_primitive_desc_destroy(about);
	dnnl_primitive_attr_destroy(attributes);
}

static void add_softmax(struct plan *plan, const dnnl_memory_desc_t *about, void *numbers)
{
	struct step *step = add(plan);
	dnnl_primitive_desc_t made;
	dnnl_softmax_desc_t softmax;

	must(dnnl_softmax_forward_desc_init(&softmax, dnnl_forward_inference, about, 2));
	must(dnnl_primitive_desc_create(&made, &softmax, NULL, plan->engine, NULL));
	must(dnnl_primitive_create(&step->primitive, made));
	argue(step, DNNL_ARG_SRC, wrap(plan, about, numbers));
	argue(step, DNNL_ARG_DST, wrap(plan, about, numbers));
	dnnl_primitive_desc_destroy(made);
}

void plan_attention(struct plan *plan, struct array q, struct array k, struct array v, size_t heads,
		    size_t batch, struct array out)
{
	const dnnl_dim_t groups = (dnnl_dim_t)(heads * batch), width = (dnnl_dim_t)q.columns;
	const dnnl_dim_t queries = (dnnl_dim_t)q.rows / groups, keys = (dnnl_dim_t)k.rows / groups;
	const dnnl_dim_t q_sizes[] = {groups, queries, width}, k_sizes[] = {groups, width, keys};
	const dnnl_dim_t v_sizes[] = {groups, keys, width}, s_sizes[] = {groups, queries, keys};
	const dnnl_data_type_t type = moving_type(plan);
	const dnnl_memory_desc_t q_about = describe(3, q_sizes, type, dnnl_abc);
	const dnnl_memory_desc_t k_about = describe(3, k_sizes, type, dnnl_acb);
	const dnnl_memory_desc_t v_about = describe(3, v_sizes, type, dnnl_abc);
	const dnnl_memory_desc_t s_about = describe(3, s_sizes, type, dnnl_abc);
	struct array scores = plan_array(plan, q.rows, (size_t)keys);
	struct array mixed = plan_array(plan, q.rows, q.columns);
	struct step *step;

	add_batched(plan, &q_about, q.numbers, &k_about, k.numbers, &s_about, scores.numbers,
		    1 / sqrtf((float)width));
	add_softmax(plan, &s_about, scores.numbers);
	add_batched(plan, &s_about, scores.numbers, &v_about, v.numbers, &q_about, mixed.numbers,
		    1);
	step = add(plan);
	step->loop = merge_heads;
	step->from = mixed;
	step->to = out;
	step->heads = heads;
	step->batch = batch;
}
