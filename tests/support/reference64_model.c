#include "support/reference64_model.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/files.h"

#define PREFIX_BYTES 8

/* A safetensors file: header and, behind it, the numbers (MODEL.md section 6). */
struct file {
	const char *name;
	const cJSON *header;
	const unsigned char *numbers;
	size_t bytes; /* of `numbers` */
	bool failed;
};

void *support_reference_allocate(size_t count, size_t size)
{
	void *block = calloc(count ? count : 1, size);

	if (!block) {
		fprintf(stderr, "reference: no memory for %zu x %zu bytes\n", count, size);
		exit(1);
	}
	return block;
}

static uint16_t u16_at(const unsigned char *p)
{
	return (uint16_t)(p[0] | p[1] << 8);
}

static double f32_from_bits(uint32_t bits)
{
	float value;

	memcpy(&value, &bits, sizeof(value));
	return value;
}

static double f16_from_bits(uint16_t bits)
{
	int exponent = bits >> 10 & 31, mantissa = bits & 1023;
	double size = exponent ? ldexp(1024 + mantissa, exponent - 25) : ldexp(mantissa, -24);

	return bits >> 15 ? -size : size;
}

static double number_at(const unsigned char *numbers, size_t index, const char *type)
{
	if (strcmp(type, "F16") == 0)
		return f16_from_bits(u16_at(numbers + 2 * index));
	if (strcmp(type, "BF16") == 0)
		return f32_from_bits((uint32_t)u16_at(numbers + 2 * index) << 16);

	const unsigned char *p = numbers + 4 * index;

	return f32_from_bits(u16_at(p) | (uint32_t)u16_at(p + 2) << 16);
}

static double *fail(struct file *file, const char *tensor, const char *fault)
{
	fprintf(stderr, "%s: %s: %s\n", file->name, tensor, fault);
	file->failed = true;
	return support_reference_allocate(1, sizeof(double));
}

/* The numbers of one tensor, in the file's order; those of a tensor that is not there are a
 * stand-in, and the file has failed. */
__attribute__((format(printf, 3, 4))) static double *tensor(struct file *file, size_t count,
							    const char *format, ...)
{
	char name[96];
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(name, sizeof(name), format, arguments);
	va_end(arguments);

	const cJSON *entry = cJSON_GetObjectItemCaseSensitive(file->header, name);
	const char *type = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(entry, "dtype"));
	const cJSON *offsets = cJSON_GetObjectItemCaseSensitive(entry, "data_offsets");

	if (!type || cJSON_GetArraySize(offsets) != 2)
		return fail(file, name, "missing");
	if (strcmp(type, "F32") != 0 && strcmp(type, "F16") != 0 && strcmp(type, "BF16") != 0)
		return fail(file, name, "not F32, F16 or BF16");

	size_t begin = (size_t)cJSON_GetArrayItem(offsets, 0)->valuedouble;
	size_t end = (size_t)cJSON_GetArrayItem(offsets, 1)->valuedouble;
	size_t width = strcmp(type, "F32") == 0 ? 4 : 2;

	if (end > file->bytes || begin > end || end - begin != count * width)
		return fail(file, name, "of another size than the config says");

	double *made = support_reference_allocate(count, sizeof(double));

	for (size_t i = 0; i < count; i++)
		made[i] = number_at(file->numbers + begin, i, type);
	return made;
}

static struct reference_matrix transposed(const struct file *file, double *rows, size_t out,
					  size_t in)
{
	struct reference_matrix matrix = {in, out, NULL};

	matrix.numbers = support_reference_allocate(in * out, sizeof(double));
	for (size_t i = 0; !file->failed && i < out; i++) {
		for (size_t j = 0; j < in; j++)
			matrix.numbers[j * out + i] = rows[i * in + j];
	}
	free(rows);
	return matrix;
}

static struct reference_half read_half(struct file *file, const struct dvsm_model_config *config,
				       uint32_t layer, const char *half)
{
	const size_t dim = config->dim, head_dim = dim / config->heads;
	const size_t hidden = config->mlp_ratio * dim;

#define TENSOR(count, rest)   tensor(file, count, "blocks.%u.%s%s.weight", layer, half, rest)
#define MATRIX(out, in, rest) transposed(file, TENSOR((out) * (in), rest), out, in)
	struct reference_half made = {
		.norm = TENSOR(dim, "_norm"),
		.q_norm = TENSOR(head_dim, ".q_norm"),
		.k_norm = TENSOR(head_dim, ".k_norm"),
		.mlp_norm = TENSOR(dim, "_mlp_norm"),
		.qkv = MATRIX(3 * dim, dim, ".qkv"),
		.out = MATRIX(dim, dim, ".out"),
		.up = MATRIX(hidden, dim, "_mlp.up"),
		.down = MATRIX(dim, hidden, "_mlp.down"),
	};
#undef MATRIX
#undef TENSOR
	return made;
}

static double number_in(const cJSON *object, const char *name)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, name);

	return cJSON_IsNumber(item) ? item->valuedouble : 0;
}

/* The config is a JSON text inside the header's JSON. */
static bool read_config(const struct file *file, struct dvsm_model_config *config)
{
	const cJSON *metadata = cJSON_GetObjectItemCaseSensitive(file->header, "__metadata__");
	const char *text =
		cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(metadata, "config"));
	cJSON *json = text ? cJSON_Parse(text) : NULL;
	const char *rgb_out =
		cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(json, "rgb_out"));

	*config = (struct dvsm_model_config){
		.dim = (uint32_t)number_in(json, "dim"),
		.heads = (uint32_t)number_in(json, "heads"),
		.layers = (uint32_t)number_in(json, "layers"),
		.patch_px = (uint32_t)number_in(json, "patch"),
		.mlp_ratio = (uint32_t)number_in(json, "mlp_ratio"),
		.norm_eps = number_in(json, "norm_eps"),
		.rgb_sigmoid = rgb_out && strcmp(rgb_out, "sigmoid") == 0,
	};

	bool usable = config->dim && config->heads && config->dim % config->heads == 0 &&
		      config->layers && config->patch_px && config->mlp_ratio &&
		      !cJSON_IsObject(cJSON_GetObjectItemCaseSensitive(json, "prior"));

	cJSON_Delete(json);
	return usable;
}

static struct support_reference *read_weights(struct file *file)
{
	struct support_reference *made = support_reference_allocate(1, sizeof(*made));
	const struct dvsm_model_config *config = &made->config;

	if (!read_config(file, &made->config)) {
		fprintf(stderr, "%s: no config that the reference can run\n", file->name);
		free(made);
		return NULL;
	}

	const size_t dim = config->dim, area = (size_t)config->patch_px * config->patch_px;

	made->patch_ray =
		transposed(file, tensor(file, dim * 6 * area, "patch_ray.weight"), dim, 6 * area);
	made->patch_rgb =
		transposed(file, tensor(file, dim * 3 * area, "patch_rgb.weight"), dim, 3 * area);
	made->to_rgb =
		transposed(file, tensor(file, 3 * area * dim, "to_rgb.weight"), 3 * area, dim);
	made->embed_norm = tensor(file, dim, "embed_norm.weight");
	made->final_norm = tensor(file, dim, "final_norm.weight");
	made->range = support_reference_allocate(1, sizeof(*made->range));
	made->blocks = support_reference_allocate(config->layers, sizeof(made->blocks[0]));
	for (uint32_t i = 0; i < config->layers; i++) {
		made->blocks[i][REFERENCE_INTRA] = read_half(file, config, i, "intra");
		made->blocks[i][REFERENCE_CROSS] = read_half(file, config, i, "cross");
	}
	if (!file->failed)
		return made;
	support_reference_close(made);
	return NULL;
}

struct support_reference *support_reference_open_bytes(const void *bytes, size_t size,
						       const char *name)
{
	const unsigned char *begin = bytes;
	struct support_reference *made = NULL;
	uint64_t header_bytes = 0;

	if (size >= PREFIX_BYTES)
		memcpy(&header_bytes, begin, PREFIX_BYTES);
	if (size < PREFIX_BYTES || header_bytes > size - PREFIX_BYTES) {
		fprintf(stderr, "%s: not a safetensors file\n", name);
		return NULL;
	}

	cJSON *header = cJSON_ParseWithLength((const char *)begin + PREFIX_BYTES, header_bytes);
	struct file file = {
		.name = name,
		.header = header,
		.numbers = begin + PREFIX_BYTES + header_bytes,
		.bytes = size - PREFIX_BYTES - header_bytes,
	};

	if (header)
		made = read_weights(&file);
	else
		fprintf(stderr, "%s: its header is not JSON\n", name);
	cJSON_Delete(header);
	return made;
}

struct support_reference *support_reference_open(const char *path)
{
	size_t size;
	unsigned char *bytes = support_read_file(path, &size);
	struct support_reference *made =
		bytes ? support_reference_open_bytes(bytes, size, path) : NULL;

	free(bytes);
	return made;
}

static void free_half(struct reference_half *half)
{
	free(half->norm);
	free(half->q_norm);
	free(half->k_norm);
	free(half->mlp_norm);
	free(half->qkv.numbers);
	free(half->out.numbers);
	free(half->up.numbers);
	free(half->down.numbers);
}

void support_reference_close(struct support_reference *reference)
{
	if (!reference)
		return;
	for (uint32_t i = 0; i < reference->config.layers; i++) {
		free_half(&reference->blocks[i][REFERENCE_INTRA]);
		free_half(&reference->blocks[i][REFERENCE_CROSS]);
	}
	free(reference->blocks);
	free(reference->patch_ray.numbers);
	free(reference->patch_rgb.numbers);
	free(reference->to_rgb.numbers);
	free(reference->embed_norm);
	free(reference->final_norm);
	free(reference->range);
	free(reference);
}

const struct dvsm_model_config *
support_reference_get_config(const struct support_reference *reference)
{
	return &reference->config;
}

const struct support_reference_range *
support_reference_get_range(const struct support_reference *reference)
{
	return reference->range;
}
