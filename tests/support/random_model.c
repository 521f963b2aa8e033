#include "support/random_model.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/model.h"
#include "weights/open.h"

#define PREFIX_BYTES 8

/* The walk over a model's tensors: measured first, then header and numbers are written together. */
struct maker {
	struct support_random *random;
	char *header;             /* NULL while measuring */
	size_t header_size, room; /* bytes of header so far; of `header`, with a 0 behind it */
	float *data;              /* behind the header */
	size_t count;             /* floats so far */
};

__attribute__((format(printf, 2, 3))) static void say(struct maker *maker, const char *format, ...)
{
	size_t used = maker->header_size;
	va_list arguments;

	va_start(arguments, format);
	int length = maker->header ? vsnprintf(maker->header + used, maker->room - used, format,
					       arguments)
				   : vsnprintf(NULL, 0, format, arguments);
	va_end(arguments);
	maker->header_size += (size_t)length;
}

/* A header entry for the next `count` floats; their place, NULL while measuring. */
static float *tensor(struct maker *maker, const char *name, const char *shape, size_t count)
{
	size_t first = maker->count;

	say(maker, ",\"%s.weight\":{\"dtype\":\"F32\",\"shape\":%s,\"data_offsets\":[%zu,%zu]}",
	    name, shape, first * sizeof(float), (first + count) * sizeof(float));
	maker->count += count;
	return maker->data ? maker->data + first : NULL;
}

static void matrix(struct maker *maker, const char *name, size_t out, size_t in)
{
	char shape[64];

	snprintf(shape, sizeof(shape), "[%zu,%zu]", out, in);

	float *at = tensor(maker, name, shape, out * in);

	if (at)
		support_random_fill(maker->random, at, out * in, sqrtf(3.0f / (float)in));
}

static void norm(struct maker *maker, const char *name, size_t dim)
{
	char shape[64];

	snprintf(shape, sizeof(shape), "[%zu]", dim);

	float *at = tensor(maker, name, shape, dim);

	for (size_t i = 0; at && i < dim; i++)
		at[i] = 1.0f + 0.2f * support_random_unit(maker->random);
}

struct name {
	char text[64];
};

static struct name half_name(uint32_t layer, const char *half, const char *rest)
{
	struct name name;

	snprintf(name.text, sizeof(name.text), "blocks.%u.%s%s", layer, half, rest);
	return name;
}

static void make_half(struct maker *maker, const struct dvsm_model_config *config, uint32_t layer,
		      const char *half)
{
	size_t dim = config->dim, head_dim = dim / config->heads, hidden = config->mlp_ratio * dim;

	norm(maker, half_name(layer, half, "_norm").text, dim);
	matrix(maker, half_name(layer, half, ".qkv").text, 3 * dim, dim);
	norm(maker, half_name(layer, half, ".q_norm").text, head_dim);
	norm(maker, half_name(layer, half, ".k_norm").text, head_dim);
	matrix(maker, half_name(layer, half, ".out").text, dim, dim);
	norm(maker, half_name(layer, half, "_mlp_norm").text, dim);
	matrix(maker, half_name(layer, half, "_mlp.up").text, hidden, dim);
	matrix(maker, half_name(layer, half, "_mlp.down").text, dim, hidden);
}

static void make_all(struct maker *maker, const struct dvsm_model_config *config)
{
	size_t dim = config->dim, area = (size_t)config->patch_px * config->patch_px;

	say(maker,
	    "{\"__metadata__\":{\"format\":\"dvsm\",\"version\":\"1\",\"config\":\"{"
	    "\\\"dim\\\":%u,\\\"heads\\\":%u,\\\"layers\\\":%u,\\\"patch\\\":%u,"
	    "\\\"mlp_ratio\\\":%u,\\\"norm_eps\\\":%.17g,\\\"rgb_out\\\":\\\"%s\\\","
	    "\\\"pose_norm\\\":\\\"gs-lrm\\\",\\\"prior\\\":null}\"}",
	    config->dim, config->heads, config->layers, config->patch_px, config->mlp_ratio,
	    config->norm_eps, config->rgb_sigmoid ? "sigmoid" : "linear");
	matrix(maker, "patch_ray", dim, 6 * area);
	matrix(maker, "patch_rgb", dim, 3 * area);
	norm(maker, "embed_norm", dim);
	for (uint32_t i = 0; i < config->layers; i++) {
		make_half(maker, config, i, "intra");
		make_half(maker, config, i, "cross");
	}
	norm(maker, "final_norm", dim);
	matrix(maker, "to_rgb", 3 * area, dim);
	say(maker, "}");
	while (maker->header_size % PREFIX_BYTES != 0)
		say(maker, " ");
}

unsigned char *support_random_model_file(const struct dvsm_model_config *config,
					 struct support_random *random, size_t *size)
{
	struct maker maker = {.random = random};

	make_all(&maker, config);

	const uint64_t header_size = maker.header_size;
	const size_t data_at = PREFIX_BYTES + maker.header_size;
	const size_t total = data_at + maker.count * sizeof(float);
	unsigned char *bytes = malloc(total);
	char *header = malloc(maker.header_size + 1);

	if (bytes && header) {
		maker = (struct maker){
			.random = random,
			.header = header,
			.room = maker.header_size + 1,
			.data = (float *)(void *)(bytes + data_at),
		};
		make_all(&maker, config);
		memcpy(bytes, &header_size, PREFIX_BYTES);
		memcpy(bytes + PREFIX_BYTES, header, maker.header_size);
		*size = total;
	} else {
		free(bytes);
		bytes = NULL;
	}
	free(header);
	return bytes;
}

struct dvsm_model *support_random_model(const struct dvsm_model_config *config,
					struct support_random *random)
{
	size_t size;
	unsigned char *bytes = support_random_model_file(config, random, &size);
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {"no memory for a random model"};

	if (!bytes || dvsm_model_open_bytes(bytes, size, "random", &model, &error) != DVSM_OK)
		printf("%s\n", error.text);
	free(bytes);
	return model;
}

struct dvsm_camera support_ring_camera(uint32_t width, uint32_t height, uint32_t index,
				       uint32_t count)
{
	double angle = 2 * M_PI * index / count, s = sin(angle), c = cos(angle);

	/* At (2 s, 0, -2 c), z axis to the origin, y axis down. */
	return (struct dvsm_camera){
		.width = width,
		.height = height,
		.fx = width,
		.fy = width,
		.cx = 0.5 * width - 0.5,
		.cy = 0.5 * height - 0.5,
		.world_from_camera = {c, 0, -s, 2 * s, 0, 1, 0, 0, s, 0, c, -2 * c, 0, 0, 0, 1},
	};
}

struct dvsm_view support_random_view(struct support_random *random,
				     const struct dvsm_camera *camera, float *rgb)
{
	const size_t numbers = (size_t)camera->width * camera->height * 3;

	for (size_t i = 0; i < numbers; i++)
		rgb[i] = 0.5f + 0.5f * support_random_unit(random);
	return (struct dvsm_view){.camera = *camera, .rgb = rgb};
}
