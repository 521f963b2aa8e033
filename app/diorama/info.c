/* info: what a file holds, told apart by content. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "core/json_out.h"
#include "core/model_choice.h"
#include "core/options.h"
#include "core/path.h"
#include "core/scene_file.h"
#include "core/session.h"
#include "dio/calibration.h"
#include "dio/camera.h"
#include "report.h"

#define PEEK_BYTES 65536

static cJSON *describe_config(const struct dvsm_model *model)
{
	const struct dvsm_model_config *config = dvsm_model_get_config(model);
	cJSON *object = cJSON_CreateObject();

	dio_json_add_text(object, "kind", "model");
	cJSON_AddNumberToObject(object, "dim", config->dim);
	cJSON_AddNumberToObject(object, "heads", config->heads);
	cJSON_AddNumberToObject(object, "layers", config->layers);
	cJSON_AddNumberToObject(object, "patch", config->patch_px);
	cJSON_AddNumberToObject(object, "mlp_ratio", config->mlp_ratio);
	cJSON_AddNumberToObject(object, "norm_eps", config->norm_eps);
	dio_json_add_text(object, "rgb_out", config->rgb_sigmoid ? "sigmoid" : "linear");
	if (config->prior_dim)
		cJSON_AddNumberToObject(object, "prior_dim", config->prior_dim);
	cJSON_AddNumberToObject(object, "weights", (double)dvsm_model_get_weight_count(model));
	cJSON_AddNumberToObject(object, "memory_bytes", (double)dvsm_model_get_weight_bytes(model));
	dio_json_add_text(object, "sha256", dvsm_model_get_sha256(model));
	return object;
}

static enum dio_status describe_model(const char *path, cJSON **about, struct dio_error *error)
{
	struct dvsm_error fault = {0};
	struct dvsm_model *model = NULL;
	struct dio_model_card card = {0};
	enum dio_status status =
		dio_status_from_engine(dvsm_model_open(path, &model, &fault), &fault, error);

	if (status == DIO_OK)
		status = dio_model_read_card(path, &card, error);
	if (status == DIO_OK)
		*about = describe_config(model);
	if (status == DIO_OK && card.tokens_per_view)
		cJSON_AddNumberToObject(*about, "tokens_per_view", card.tokens_per_view);
	if (status == DIO_OK && card.deblock)
		cJSON_AddTrueToObject(*about, "deblock");
	dvsm_model_close(model);
	return status;
}

static enum dio_status describe_cache(const char *path, cJSON **about, struct dio_error *error)
{
	struct dvsm_scene_info info = {0};
	struct dvsm_error fault = {0};
	enum dio_status status =
		dio_status_from_engine(dvsm_scene_probe(path, &info, &fault), &fault, error);

	if (status != DIO_OK)
		return status;
	*about = cJSON_CreateObject();
	dio_json_add_text(*about, "kind", "scene cache");
	cJSON_AddNumberToObject(*about, "views", info.views);
	cJSON_AddNumberToObject(*about, "tokens", (double)info.tokens);
	cJSON_AddNumberToObject(*about, "patch_recon", info.patch_px);
	cJSON_AddNumberToObject(*about, "dim", info.dim);
	cJSON_AddNumberToObject(*about, "heads", info.heads);
	cJSON_AddNumberToObject(*about, "layers", info.layers);
	cJSON_AddNumberToObject(*about, "cache_bytes", (double)info.cache_bytes);
	dio_json_add_text(*about, "model_sha256", info.model_sha256);
	return DIO_OK;
}

static enum dio_status describe_scene(const char *path, cJSON **about, struct dio_error *error)
{
	struct dio_scene_file scene = {0};
	enum dio_status status = dio_scene_file_read(path, &scene, error);

	if (status != DIO_OK)
		return status;
	*about = cJSON_CreateObject();
	dio_json_add_text(*about, "kind", "scene");
	dio_json_add_text(*about, "name", scene.name);
	cJSON_AddNumberToObject(*about, "context_views",
				dio_scene_file_count(&scene, DIO_ROLE_CONTEXT));
	cJSON_AddNumberToObject(*about, "targets", dio_scene_file_count(&scene, DIO_ROLE_TARGET));
	cJSON_AddItemToObject(*about, "camera", dio_json_camera(&scene.frames[0].camera));
	dio_scene_file_deinit(&scene);
	return DIO_OK;
}

static enum dio_status describe_camera(const char *path, cJSON **about, struct dio_error *error)
{
	struct dio_camera_model model = {0};
	enum dio_status status = dio_camera_model_read(path, &model, error);

	if (status != DIO_OK)
		return status;
	*about = dio_json_camera(&model);
	dio_json_add_text(*about, "kind", "camera");
	return DIO_OK;
}

/* A recording or a folder of pictures: what replay makes of it. */
static enum dio_status describe_frames(const char *path, cJSON **about, struct dio_error *error)
{
	const struct dio_camera_options options = {.as_fast_as_possible = true,
						   .every_frame = true};
	struct dio_camera_info info = {0};
	struct dio_camera *camera = NULL;
	char *spec;
	enum dio_status status;

	if (asprintf(&spec, "replay:%s", path) < 0)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
	status = dio_camera_open(spec, &options, &camera, error);
	free(spec);
	if (status != DIO_OK)
		return status;
	dio_camera_get_info(camera, &info);
	dio_camera_close(camera);
	*about = cJSON_CreateObject();
	dio_json_add_text(*about, "kind", "recording");
	dio_json_add_text(*about, "name", info.name);
	cJSON_AddNumberToObject(*about, "frames", (double)info.frame_count);
	cJSON_AddNumberToObject(*about, "width", info.width);
	cJSON_AddNumberToObject(*about, "height", info.height);
	dio_json_add_text(*about, "format", dio_pixel_format_name(info.format));
	if (info.frames_per_second > 0)
		dio_json_add_number(*about, "frames_per_second", info.frames_per_second, 3);
	return DIO_OK;
}

static bool is_json_name(const char *path)
{
	size_t length = strlen(path);

	return length > 5 && strcmp(path + length - 5, ".json") == 0;
}

/* Does the head of a file hold a word? */
static bool holds(const char *head, size_t size, const char *word)
{
	return memmem(head, size, word, strlen(word)) != NULL;
}

static enum dio_status describe_file(const char *path, cJSON **about, struct dio_error *error)
{
	char *head = malloc(PEEK_BYTES);
	FILE *stream = head ? fopen(path, "rbe") : NULL;
	size_t size = stream ? fread(head, 1, PEEK_BYTES, stream) : 0;
	enum dio_status status;

	if (!head)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory to look into it", path);
	else if (!stream)
		status = dio_fail(error, dio_status_from_errno(errno), "%s: cannot open: %s", path,
				  strerror(errno));
	/* safetensors: eight bytes of length, then a JSON object. */
	else if (size > 9 && head[8] == '{')
		status = holds(head, size, "model_sha256") ? describe_cache(path, about, error)
							   : describe_model(path, about, error);
	else if (is_json_name(path) || holds(head, size, "world_from_camera"))
		status = describe_scene(path, about, error);
	else if (holds(head, size, "camera_matrix"))
		status = describe_camera(path, about, error);
	else
		status = dio_fail(error, DIO_BAD_FILE,
				  "%s: is not a model, a scene cache, scene.json, camera.yaml or a "
				  "recording",
				  path);
	if (stream)
		fclose(stream);
	free(head);
	return status;
}

static enum dio_status describe(const char *path, cJSON **about, struct dio_error *error)
{
	char *inside;
	bool scene;

	if (!dio_path_is_folder(path))
		return describe_file(path, about, error);
	inside = dio_path_join(path, "scene.json");
	scene = inside && dio_path_is_file(inside);
	free(inside);
	return scene ? describe_scene(path, about, error) : describe_frames(path, about, error);
}

static void print_member(const cJSON *item, int indent)
{
	const cJSON *child;
	char *text;

	if (cJSON_IsString(item)) {
		printf("%*s%-18s%s\n", indent, "", item->string, item->valuestring);
	} else if (cJSON_IsObject(item)) {
		printf("%*s%s\n", indent, "", item->string);
		cJSON_ArrayForEach(child, item) print_member(child, indent + 2);
	} else {
		text = cJSON_PrintUnformatted(item);
		printf("%*s%-18s%s\n", indent, "", item->string, text ? text : "");
		cJSON_free(text);
	}
}

int dio_command_info(int argc, char **argv)
{
	bool json = false;
	const struct dio_option options[] = {
		{"json", DIO_OPTION_FLAG, NULL, "as JSON", &json, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "info",
		.summary = "say what a file holds",
		.arguments = "FILE",
		.details =
			"FILE is a model, a scene cache, a scene.json, a camera.yaml (OpenCV or "
			"ROS), a recording,\nor a folder of pictures. It is checked as a command "
			"that uses it would.",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	enum dio_status status;
	cJSON *about = NULL;
	const cJSON *item;
	char **arguments;
	uint32_t count;
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	status = describe(arguments[0], &about, &error);
	if (status == DIO_OK && json) {
		status = dio_json_print(about, &error);
	} else if (status == DIO_OK) {
		cJSON_ArrayForEach(item, about) print_member(item, 0);
		cJSON_Delete(about);
	}
	return status == DIO_OK ? DIO_EXIT_OK : dio_report_failure(usage.command, &error);
}
