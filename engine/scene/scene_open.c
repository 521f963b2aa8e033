#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "files/safetensors.h"
#include "geometry/rays.h"
#include "model/config.h"
#include "model/range.h"
#include "scene/scene_file.h"
#include "scene/scene_internal.h"

/*
 * The stored normalisation may differ from the one computed here by rounding, were it written by
 * another version; by more than this share it belongs to other cameras.
 */
#define NORMALISATION_TOLERANCE 1e-6

/* What is read before the cache: the header's promises, and the cameras. */
struct reading {
	struct dvsm_safetensors file;
	const char *name; /* for error texts */
	const char *config_text, *model_sha256, *sha256;
	struct dvsm_model_config sizes; /* dim, heads, layers */
	uint32_t patch_px, views;
	enum dvsm_precision precision; /* told by the type of the cache */
	struct dvsm_tensor *cameras, *normalisation, *keys, *values;
	struct dvsm_tensor *k_scale, *v_scale, *v_mean; /* NULL but in fixed */
	uint64_t tokens;
	double *camera_numbers; /* [views][22] as they lie in the file; owned */
	double normalisation_numbers[DVSM_SCENE_NORMALISATION_NUMBERS];
	struct dvsm_scene *scene; /* owned until it is handed out */
};

static bool is_sha256(const char *text)
{
	return text && strlen(text) == 64 && strspn(text, "0123456789abcdef") == 64;
}

static enum dvsm_status read_metadata(struct reading *r, struct dvsm_error *error)
{
	const char *format = dvsm_safetensors_get_metadata(&r->file, "format");
	const char *version = dvsm_safetensors_get_metadata(&r->file, "version");
	if (!format || strcmp(format, DVSM_SCENE_FORMAT) != 0)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: is no scene: metadata format is %.40s, must be %s", r->name,
				 format ? format : "missing", DVSM_SCENE_FORMAT);
	if (!version || strcmp(version, DVSM_SCENE_VERSION) != 0)
		return dvsm_fail(error, version ? DVSM_UNSUPPORTED : DVSM_BAD_FILE,
				 "%s: scene version %.40s is not known to this build, only %s",
				 r->name, version ? version : "(missing)", DVSM_SCENE_VERSION);

	r->config_text = dvsm_safetensors_get_metadata(&r->file, "config");
	r->model_sha256 = dvsm_safetensors_get_metadata(&r->file, "model_sha256");
	r->sha256 = dvsm_safetensors_get_metadata(&r->file, "sha256");
	if (!is_sha256(r->model_sha256) || !is_sha256(r->sha256))
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: metadata %s is not 64 lower-case hex digits", r->name,
				 is_sha256(r->sha256) ? "model_sha256" : "sha256");
	return DVSM_OK;
}

static enum dvsm_status read_config(struct reading *r, struct dvsm_error *error)
{
	struct dvsm_json json;
	enum dvsm_status status = dvsm_config_open(r->config_text, r->name, &json, error);
	if (status != DVSM_OK)
		return status;
	status = dvsm_config_get_sizes(&json, r->name, &r->sizes.dim, &r->sizes.heads,
				       &r->sizes.layers, error);
	if (status == DVSM_OK)
		status = dvsm_config_get_count(&json, r->name, "patch", 1, DVSM_MAX_PATCH_PX,
					       &r->patch_px, error);
	dvsm_json_deinit(&json);
	return status;
}

/* A scene of another model is refused before anything large is read. */
static enum dvsm_status check_model(const struct reading *r, const struct dvsm_model *model,
				    struct dvsm_error *error)
{
	const struct dvsm_model_config *config = dvsm_model_get_config(model);
	const char *sha256 = dvsm_scene_model_of(model, r->precision);
	if (strcmp(sha256, r->model_sha256) != 0)
		return dvsm_fail(error, DVSM_MISMATCH,
				 "%s: was made with model %s, not with %s: open it with its own "
				 "model or reconstruct it again",
				 r->name, r->model_sha256, sha256);
	if (config->dim != r->sizes.dim || config->heads != r->sizes.heads ||
	    config->layers != r->sizes.layers)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: config: dim, heads and layers are not the model's", r->name);
	return DVSM_OK;
}

/* How many of the padded tokens there are: the cameras, which say it too, are not read yet. */
static enum dvsm_status read_tokens(struct reading *r, uint64_t padded, struct dvsm_error *error)
{
	struct dvsm_json json;
	uint32_t tokens;
	enum dvsm_status status = dvsm_config_open(r->config_text, r->name, &json, error);
	if (status != DVSM_OK)
		return status;
	status = dvsm_config_get_count(&json, r->name, "tokens", 1, INT32_MAX, &tokens, error);
	dvsm_json_deinit(&json);
	if (status == DVSM_OK && dvsm_fixed_pad(tokens, DVSM_FIXED_KEY_PAD) != padded)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: tensor keys: holds %llu tokens, config's %u would be filled "
				 "up to a multiple of %u",
				 r->name, (unsigned long long)padded, tokens, DVSM_FIXED_KEY_PAD);
	r->tokens = tokens;
	return status;
}

/* The cache of a fixed-point scene. */
static enum dvsm_status find_fixed(struct reading *r, const struct dvsm_tensor *keys,
				   struct dvsm_error *error)
{
	const enum dvsm_dtype i8 = DVSM_DTYPE_I8, i16 = DVSM_DTYPE_I16;
	const uint64_t padded = keys->rank == 4 ? keys->shape[2] : 0;
	const uint64_t cache[4] = {r->sizes.layers, r->sizes.heads, padded,
				   dvsm_fixed_pad(r->sizes.dim / r->sizes.heads, DVSM_FIXED_HEAD)};
	const uint64_t scales[3] = {r->sizes.layers, r->sizes.dim, 2};
	const struct {
		const char *name;
		const enum dvsm_dtype *dtype;
		uint32_t rank;
		const uint64_t *shape;
		struct dvsm_tensor **tensor;
	} wanted[] = {
		{"keys", &i8, 4, cache, &r->keys},
		{"turned_values", &i8, 4, cache, &r->values},
		{"k_scale", &i16, 3, scales, &r->k_scale},
		{"v_scale", &i16, 3, scales, &r->v_scale},
		{"v_mean", &i16, 2, scales, &r->v_mean},
	};
	r->precision = DVSM_PRECISION_FIXED;
	for (size_t i = 0; i < sizeof(wanted) / sizeof(wanted[0]); i++) {
		enum dvsm_status status = dvsm_safetensors_require(
			&r->file, wanted[i].name, wanted[i].dtype, wanted[i].rank, wanted[i].shape,
			wanted[i].tensor, error);
		if (status != DVSM_OK)
			return status;
	}
	return read_tokens(r, padded, error);
}

/* Find the tensors and check what the header alone can tell. */
static enum dvsm_status find_tensors(struct reading *r, struct dvsm_error *error)
{
	const enum dvsm_dtype f64 = DVSM_DTYPE_F64;
	struct dvsm_tensor *cameras = dvsm_safetensors_find(&r->file, "cameras");
	uint64_t views = cameras && cameras->rank == 2 ? cameras->shape[0] : 1;
	if (views < 1 || views > DVSM_MAX_VIEWS)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: tensor cameras: %llu views, must be 1..%u", r->name,
				 (unsigned long long)views, DVSM_MAX_VIEWS);
	r->views = (uint32_t)views;

	const uint64_t camera_shape[2] = {views, DVSM_SCENE_CAMERA_NUMBERS};
	const uint64_t normalisation_shape[1] = {DVSM_SCENE_NORMALISATION_NUMBERS};
	enum dvsm_status status = dvsm_safetensors_require(&r->file, "cameras", &f64, 2,
							   camera_shape, &r->cameras, error);
	if (status == DVSM_OK)
		status = dvsm_safetensors_require(&r->file, "normalisation", &f64, 1,
						  normalisation_shape, &r->normalisation, error);
	if (status != DVSM_OK)
		return status;

	/* The tokens are known only from the cameras: here the cache must agree with itself. */
	const struct dvsm_tensor *keys = dvsm_safetensors_find(&r->file, "keys");
	const uint64_t cache_shape[4] = {r->sizes.layers, r->sizes.heads,
					 keys && keys->rank == 4 ? keys->shape[2] : 0,
					 r->sizes.dim / r->sizes.heads};
	if (keys && keys->dtype == DVSM_DTYPE_BF16)
		r->precision = DVSM_PRECISION_BF16;
	if (keys && keys->dtype == DVSM_DTYPE_I8)
		return find_fixed(r, keys, error);
	r->tokens = cache_shape[2];
	const enum dvsm_dtype dtype = dvsm_scene_dtype(r->precision);
	status =
		dvsm_safetensors_require(&r->file, "keys", &dtype, 4, cache_shape, &r->keys, error);
	if (status == DVSM_OK)
		status = dvsm_safetensors_require(&r->file, "values", &dtype, 4, cache_shape,
						  &r->values, error);
	return status;
}

/* Numbers that were bfloat16 in the file are so again. */
static void place_bf16(const struct dvsm_tensor *tensor, size_t first, const float *numbers,
		       size_t count)
{
	dvsm_bf16 *to = (dvsm_bf16 *)tensor->destination + first;
	for (size_t i = 0; i < count; i++)
		to[i] = dvsm_bf16_round(numbers[i]);
}

/* Room for what the tensors hold; the header's sizes were checked against the file's. */
static enum dvsm_status make_room(struct reading *r, bool with_cache, struct dvsm_error *error)
{
	struct dvsm_scene sizes = {
		.dim = r->sizes.dim,
		.heads = r->sizes.heads,
		.layers = r->sizes.layers,
		.precision = r->precision,
		.views = r->views,
		.patch_px = r->patch_px,
		.tokens = (size_t)r->tokens,
	};
	memcpy(sizes.model_sha256, r->model_sha256, sizeof(sizes.model_sha256));
	enum dvsm_status status = dvsm_scene_make(&sizes, with_cache, &r->scene, error);
	if (status != DVSM_OK)
		return status;
	r->camera_numbers = calloc((size_t)r->views * DVSM_SCENE_CAMERA_NUMBERS, sizeof(double));
	if (!r->camera_numbers)
		return dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to read it", r->name);
	r->cameras->destination = r->camera_numbers;
	r->normalisation->destination = r->normalisation_numbers;
	r->keys->destination = r->scene->keys;
	r->values->destination = r->scene->values;
	if (r->precision == DVSM_PRECISION_BF16)
		r->keys->place = r->values->place = place_bf16;
	if (r->precision == DVSM_PRECISION_FIXED) {
		r->k_scale->destination = r->scene->fixed.k_scale;
		r->v_scale->destination = r->scene->fixed.v_scale;
		r->v_mean->destination = r->scene->fixed.v_mean;
	}
	return DVSM_OK;
}

static enum dvsm_status load_tensors(struct reading *r, struct dvsm_error *error)
{
	struct dvsm_sha256 hash;
	char hex[DVSM_SHA256_HEX];
	dvsm_sha256_init(&hash);
	dvsm_sha256_update(&hash, r->config_text, strlen(r->config_text));
	dvsm_sha256_update(&hash, r->model_sha256, strlen(r->model_sha256));
	enum dvsm_status status = dvsm_safetensors_load(&r->file, &hash, NULL, error);
	if (status != DVSM_OK)
		return status;
	dvsm_sha256_finish(&hash, hex);
	if (strcmp(hex, r->sha256) != 0)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: the checksum is wrong: the file is damaged, copy it again",
				 r->name);
	return DVSM_OK;
}

/* A file may hold any numbers under a sound checksum: none that a picture would overflow with. */
static enum dvsm_status check_range(const struct reading *r, const struct dvsm_model *model,
				    struct dvsm_error *error)
{
	if (dvsm_range_holds_cache(model, r->keys->largest, r->values->largest))
		return DVSM_OK;
	return dvsm_fail(error, DVSM_BAD_FILE,
			 "%s: tensors keys and values: numbers of up to %.3g and %.3g can leave "
			 "the range of float32: reconstruct the scene again",
			 r->name, (double)r->keys->largest, (double)r->values->largest);
}

/* What no rounding makes: such a scale belongs to no cache. */
static enum dvsm_status check_scales(const struct reading *r, struct dvsm_error *error)
{
	const struct dvsm_fixed_cache *fixed = &r->scene->fixed;
	const struct dvsm_fixed_scale *scales[2] = {fixed->k_scale, fixed->v_scale};
	for (int s = 0; s < 2 && scales[s]; s++) {
		for (size_t i = 0; i < fixed->layer_count * fixed->dim; i++) {
			int mantissa = scales[s][i].mantissa, exponent = scales[s][i].exponent;
			if (mantissa != 0 &&
			    (mantissa < 1 << 14 || exponent < -256 || exponent > 256))
				return dvsm_fail(error, DVSM_BAD_FILE,
						 "%s: tensor %c_scale: number %zu is no scale",
						 r->name, "kv"[s], i);
		}
	}
	return DVSM_OK;
}

/* A whole number of pixels out of a double; 0, which no check lets pass, when it is none. */
static uint32_t side_of(double number)
{
	return number >= 1 && number <= DVSM_MAX_SIDE_PX && number == floor(number)
		       ? (uint32_t)number
		       : 0;
}

static enum dvsm_status unpack_cameras(struct reading *r, struct dvsm_error *error)
{
	for (uint32_t i = 0; i < r->views; i++) {
		const double *numbers = r->camera_numbers + (size_t)i * DVSM_SCENE_CAMERA_NUMBERS;
		struct dvsm_camera *camera = &r->scene->cameras[i];
		camera->width = side_of(numbers[0]);
		camera->height = side_of(numbers[1]);
		camera->fx = numbers[2];
		camera->fy = numbers[3];
		camera->cx = numbers[4];
		camera->cy = numbers[5];
		memcpy(camera->world_from_camera, numbers + 6, sizeof(camera->world_from_camera));

		char what[224];
		snprintf(what, sizeof(what), "%s: tensor cameras: view %u", r->name, i);
		enum dvsm_status status = dvsm_camera_check(camera, what, error);
		if (status != DVSM_OK)
			return DVSM_BAD_FILE;
	}
	return DVSM_OK;
}

/* Largest difference of the stored normalisation from the computed, as a share of its size. */
static double normalisation_error(const struct reading *r)
{
	const struct dvsm_normalisation *n = &r->scene->normalisation;
	const double *stored = r->normalisation_numbers;
	double largest = 0, extent = 1 / n->scale;
	for (int i = 0; i < 9; i++)
		largest = fmax(largest, fabs(stored[i] - n->axes[i]));
	for (int i = 0; i < 3; i++) {
		double size = fmax(extent, fabs(n->origin[i]));
		largest = fmax(largest, fabs(stored[9 + i] - n->origin[i]) / size);
	}
	return fmax(largest, fabs(stored[12] / n->scale - 1));
}

static enum dvsm_status place_cameras(struct reading *r, struct dvsm_error *error)
{
	struct dvsm_scene *scene = r->scene;
	enum dvsm_status status = unpack_cameras(r, error);
	if (status != DVSM_OK)
		return status;
	dvsm_scene_place_cameras(scene);
	if (scene->first_token[scene->views] != scene->tokens)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: tensor keys: holds %zu tokens, the cameras make %zu", r->name,
				 scene->tokens, scene->first_token[scene->views]);
	if (!(normalisation_error(r) <= NORMALISATION_TOLERANCE))
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: tensor normalisation: does not belong to the cameras",
				 r->name);

	/* The stored one is what the cache was made with. */
	struct dvsm_normalisation *n = &scene->normalisation;
	memcpy(n->axes, r->normalisation_numbers, sizeof(n->axes));
	memcpy(n->origin, r->normalisation_numbers + 9, sizeof(n->origin));
	n->scale = r->normalisation_numbers[12];
	return DVSM_OK;
}

static enum dvsm_status read_scene(struct reading *r, const struct dvsm_model *model,
				   bool with_cache, struct dvsm_error *error)
{
	enum dvsm_status status = read_metadata(r, error);
	if (status == DVSM_OK)
		status = read_config(r, error);
	if (status == DVSM_OK)
		status = find_tensors(r, error);
	if (status == DVSM_OK && model)
		status = check_model(r, model, error);
	if (status == DVSM_OK)
		status = make_room(r, with_cache, error);
	if (status == DVSM_OK)
		status = load_tensors(r, error);
	if (status == DVSM_OK && model)
		status = check_range(r, model, error);
	if (status == DVSM_OK)
		status = check_scales(r, error);
	if (status == DVSM_OK)
		status = place_cameras(r, error);
	if (status == DVSM_OK && with_cache && r->precision == DVSM_PRECISION_FIXED)
		dvsm_fixed_cache_refine(&r->scene->fixed);
	if (status == DVSM_OK && with_cache && r->precision == DVSM_PRECISION_BF16)
		status = dvsm_scene_lay(r->scene, error);
	return status;
}

/* Reads and closes r->file. */
static enum dvsm_status open_scene(struct reading *r, const struct dvsm_model *model,
				   bool with_cache, struct dvsm_scene **scene,
				   struct dvsm_error *error)
{
	r->name = dvsm_name_tail(r->file.source.name);
	enum dvsm_status status = read_scene(r, model, with_cache, error);
	dvsm_safetensors_close(&r->file);
	free(r->camera_numbers);
	if (status == DVSM_OK)
		*scene = r->scene;
	else
		dvsm_scene_destroy(r->scene);
	return status;
}

enum dvsm_status dvsm_scene_open(const char *path, const struct dvsm_model *model,
				 struct dvsm_scene **scene, struct dvsm_error *error)
{
	struct reading r = {0};
	if (!path || !model || !scene)
		return dvsm_fail(error, DVSM_BAD_ARG, "no scene file, or no model to open it with");
	enum dvsm_status status = dvsm_safetensors_open(path, &r.file, error);
	return status == DVSM_OK ? open_scene(&r, model, true, scene, error) : status;
}

enum dvsm_status dvsm_scene_open_bytes(const void *bytes, size_t size, const char *name,
				       const struct dvsm_model *model, struct dvsm_scene **scene,
				       struct dvsm_error *error)
{
	struct reading r = {0};
	enum dvsm_status status = dvsm_safetensors_open_bytes(bytes, size, name, &r.file, error);
	return status == DVSM_OK ? open_scene(&r, model, true, scene, error) : status;
}

enum dvsm_status dvsm_scene_probe(const char *path, struct dvsm_scene_info *info,
				  struct dvsm_error *error)
{
	struct reading r = {0};
	struct dvsm_scene *scene;
	if (!path || !info)
		return dvsm_fail(error, DVSM_BAD_ARG, "no scene file was named");
	enum dvsm_status status = dvsm_safetensors_open(path, &r.file, error);
	if (status == DVSM_OK)
		status = open_scene(&r, NULL, false, &scene, error);
	if (status != DVSM_OK)
		return status;
	*info = (struct dvsm_scene_info){
		.views = scene->views,
		.layers = scene->layers,
		.heads = scene->heads,
		.dim = scene->dim,
		.patch_px = scene->patch_px,
		.tokens = scene->tokens,
		.cache_bytes = scene->cache_bytes,
		.precision = scene->precision,
	};
	memcpy(info->model_sha256, scene->model_sha256, sizeof(info->model_sha256));
	dvsm_scene_destroy(scene);
	return DVSM_OK;
}
