#include "bench/draw.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define CHUNK        4096   /* numbers written at a time */
#define TARGET_PLACE 0.0703 /* of the target on the ring, where no view will be */

static const struct dio_draw_size SIZES[] = {
	{
		.name = "small",
		.model = {.dim = 384,
			  .heads = 6,
			  .layers = 8,
			  .patch_px = 8,
			  .mlp_ratio = 4,
			  .norm_eps = 1e-6},
		.width = 128,
		.height = 128,
		.patches = "8,16",
		.views = "4,16",
		.runs = 7,
	},
	{
		.name = "paper",
		.model = {.dim = 768,
			  .heads = 12,
			  .layers = 12,
			  .patch_px = 16,
			  .mlp_ratio = 4,
			  .norm_eps = 1e-6},
		.width = 960,
		.height = 540,
		.patches = "16",
		.views = "4",
		.runs = 3,
	},
};

const struct dio_draw_size *dio_draw_find(const char *name)
{
	for (size_t i = 0; i < sizeof SIZES / sizeof *SIZES; i++)
		if (strcmp(SIZES[i].name, name) == 0)
			return &SIZES[i];
	return NULL;
}

/* splitmix64 (Steele, Lea, Flood, 2014). */
static uint64_t draw(uint64_t *state)
{
	uint64_t z = *state += 0x9e3779b97f4a7c15u;

	z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
	z = (z ^ z >> 27) * 0x94d049bb133111ebu;
	return z ^ z >> 31;
}

/* Uniform in [-1, 1). */
static float draw_unit(uint64_t *state)
{
	return (float)(draw(state) >> 40) * 0x1p-23f - 1.0f;
}

/* Called for every tensor in the file's order; a vector has no columns. */
typedef void visit_fn(void *context, const char *name, uint32_t rows, uint32_t columns);

static void visit_half(const struct dvsm_model_config *config, uint32_t layer, const char *half,
		       visit_fn *visit, void *context)
{
	const uint32_t dim = config->dim, head_dim = dim / config->heads;
	const uint32_t hidden = config->mlp_ratio * dim;
	const struct {
		const char *rest;
		uint32_t rows, columns;
	} tensors[] = {
		{"_norm", dim, 0},        {".qkv", 3 * dim, dim},     {".q_norm", head_dim, 0},
		{".k_norm", head_dim, 0}, {".out", dim, dim},         {"_mlp_norm", dim, 0},
		{"_mlp.up", hidden, dim}, {"_mlp.down", dim, hidden},
	};
	char name[64];

	for (size_t i = 0; i < sizeof tensors / sizeof *tensors; i++) {
		snprintf(name, sizeof name, "blocks.%u.%s%s", layer, half, tensors[i].rest);
		visit(context, name, tensors[i].rows, tensors[i].columns);
	}
}

static void visit_model(const struct dvsm_model_config *config, visit_fn *visit, void *context)
{
	const uint32_t dim = config->dim, area = config->patch_px * config->patch_px;

	visit(context, "patch_ray", dim, 6 * area);
	visit(context, "patch_rgb", dim, 3 * area);
	visit(context, "embed_norm", dim, 0);
	for (uint32_t layer = 0; layer < config->layers; layer++) {
		visit_half(config, layer, "intra", visit, context);
		visit_half(config, layer, "cross", visit, context);
	}
	visit(context, "final_norm", dim, 0);
	visit(context, "to_rgb", 3 * area, dim);
}

struct header {
	cJSON *root;
	double used_bytes;
};

static void describe_tensor(void *context, const char *name, uint32_t rows, uint32_t columns)
{
	struct header *header = context;
	const double bytes = (double)rows * (columns ? columns : 1) * sizeof(float);
	const double offsets[2] = {header->used_bytes, header->used_bytes + bytes};
	const int shape[2] = {(int)rows, (int)columns};
	cJSON *tensor = cJSON_CreateObject();
	char key[80];

	snprintf(key, sizeof key, "%s.weight", name);
	cJSON_AddStringToObject(tensor, "dtype", "F32");
	cJSON_AddItemToObject(tensor, "shape", cJSON_CreateIntArray(shape, columns ? 2 : 1));
	cJSON_AddItemToObject(tensor, "data_offsets", cJSON_CreateDoubleArray(offsets, 2));
	cJSON_AddItemToObject(header->root, key, tensor);
	header->used_bytes += bytes;
}

/* The JSON text ahead of the numbers, padded to whole words; NULL when memory is short. */
static char *make_header(const struct dvsm_model_config *config)
{
	struct header header = {.root = cJSON_CreateObject()};
	cJSON *metadata = cJSON_AddObjectToObject(header.root, "__metadata__");
	char *text, *padded = NULL, about[256];
	int length;

	snprintf(about, sizeof about,
		 "{\"dim\":%u,\"heads\":%u,\"layers\":%u,\"patch\":%u,\"mlp_ratio\":%u,"
		 "\"norm_eps\":%.17g,\"rgb_out\":\"linear\",\"pose_norm\":\"gs-lrm\",\"prior\":"
		 "null}",
		 config->dim, config->heads, config->layers, config->patch_px, config->mlp_ratio,
		 config->norm_eps);
	cJSON_AddStringToObject(metadata, "format", "dvsm");
	cJSON_AddStringToObject(metadata, "version", "1");
	cJSON_AddStringToObject(metadata, "config", about);
	visit_model(config, describe_tensor, &header);
	text = cJSON_PrintUnformatted(header.root);
	cJSON_Delete(header.root);
	if (!text)
		return NULL;
	length = (int)((strlen(text) + 7) / 8 * 8);
	if (asprintf(&padded, "%-*s", length, text) < 0)
		padded = NULL;
	cJSON_free(text);
	return padded;
}

struct numbers {
	FILE *stream;
	uint64_t state;
};

/* A failed write stays on the stream and is told at the end. */
static void write_tensor(void *context, const char *name, uint32_t rows, uint32_t columns)
{
	struct numbers *numbers = context;
	const float scale = columns ? sqrtf(3.0f / (float)columns) : 0.2f;
	const float mean = columns ? 0.0f : 1.0f;
	size_t left = (size_t)rows * (columns ? columns : 1);
	float chunk[CHUNK];

	(void)name;
	while (left > 0 && !ferror(numbers->stream)) {
		size_t count = left < CHUNK ? left : CHUNK;

		for (size_t i = 0; i < count; i++)
			chunk[i] = mean + scale * draw_unit(&numbers->state);
		fwrite(chunk, sizeof *chunk, count, numbers->stream);
		left -= count;
	}
}

enum dio_status dio_draw_model(const struct dvsm_model_config *config, FILE *stream,
			       struct dio_error *error)
{
	struct numbers numbers = {.stream = stream, .state = 1};
	char *header = make_header(config);
	uint64_t size;

	if (!header)
		return dio_fail(error, DIO_NO_MEM, "no memory for a model's header");
	size = strlen(header);
	fwrite(&size, sizeof size, 1, stream);
	fwrite(header, 1, size, stream);
	free(header);
	visit_model(config, write_tensor, &numbers);
	if (fflush(stream) == 0 && !ferror(stream))
		return DIO_OK;
	return dio_fail(error, dio_status_from_errno(errno),
			"a drawn model cannot be written: %s: is there room for it?",
			strerror(errno));
}

/* 0, 1/2, 1/4, 3/4, 1/8 ...: the bits of a number behind the point (van der Corput). */
static double spread(uint32_t index)
{
	double at = 0;

	for (double bit = 0.5; index > 0; index >>= 1, bit *= 0.5)
		at += (index & 1) * bit;
	return at;
}

/* On a ring of radius 2, looking at its centre, y axis down; `at` in turns. */
static void place(struct dio_view *view, uint32_t width, uint32_t height, double at)
{
	const double angle = 2 * M_PI * at, s = sin(angle), c = cos(angle);
	const double pose[16] = {c, 0, -s, 2 * s, 0, 1, 0, 0, s, 0, c, -2 * c, 0, 0, 0, 1};

	view->camera = (struct dio_camera_model){
		.width = width,
		.height = height,
		.fx = width,
		.fy = width,
		.cx = 0.5 * width - 0.5,
		.cy = 0.5 * height - 0.5,
	};
	memcpy(view->pose.world_from_camera, pose, sizeof pose);
}

/* Grey noise over a slope of colour: no two patches alike, as in a photograph. */
static enum dio_status paint(struct dio_view *view, uint64_t *state, struct dio_error *error)
{
	enum dio_status status =
		dio_picture_init(&view->picture, view->camera.width, view->camera.height);
	uint8_t *pixel = view->picture.rgb;

	if (status != DIO_OK)
		return dio_fail(error, status, "no memory for a %ux%u picture", view->camera.width,
				view->camera.height);
	for (uint32_t y = 0; y < view->camera.height; y++) {
		for (uint32_t x = 0; x < view->camera.width; x++, pixel += 3) {
			uint32_t noise = draw(state) >> 57;

			pixel[0] = (uint8_t)(noise + 128 * x / view->camera.width);
			pixel[1] = (uint8_t)(noise + 128 * y / view->camera.height);
			pixel[2] = (uint8_t)(noise + 64);
		}
	}
	return DIO_OK;
}

enum dio_status dio_draw_views(uint32_t width, uint32_t height, uint32_t count,
			       struct dio_view_set *set, struct dio_error *error)
{
	struct dio_view_set made = {.context = calloc(count, sizeof *made.context),
				    .target = calloc(1, sizeof *made.target)};
	enum dio_status status = DIO_OK;
	uint64_t state = 2;

	if (!made.context || !made.target)
		status = dio_fail(error, DIO_NO_MEM, "no memory for %u views", count);
	for (uint32_t i = 0; status == DIO_OK && i < count; i++) {
		struct dio_view *view = &made.context[made.context_count++];

		place(view, width, height, spread(i));
		if (asprintf(&view->name, "%03u", i) < 0) {
			view->name = NULL;
			status = dio_fail(error, DIO_NO_MEM, "no memory for %u views", count);
		} else {
			status = paint(view, &state, error);
		}
	}
	if (status == DIO_OK) {
		made.target_count = 1;
		place(made.target, width, height, TARGET_PLACE);
		made.target->name = strdup("000");
		if (!made.target->name)
			status = dio_fail(error, DIO_NO_MEM, "no memory for %u views", count);
	}
	if (status == DIO_OK)
		*set = made;
	else
		dio_view_set_deinit(&made);
	return status;
}
