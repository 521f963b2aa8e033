/* quantize: a model in int8, and what that costs each matrix. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "core/json_out.h"
#include "core/log.h"
#include "core/model_choice.h"
#include "core/options.h"
#include "core/session.h"

struct quantize_job {
	const char *model, *out, *calibration;
	bool report, json;
	cJSON *matrices, *layers;
};

static void report_matrix(void *context, const char *tensor, double all_db, double worst_row_db)
{
	const struct quantize_job *job = context;
	cJSON *item;

	if (!job->json) {
		printf("%-34s %6.1f dB, worst row %6.1f dB\n", tensor, all_db, worst_row_db);
		return;
	}
	item = cJSON_CreateObject();
	dio_json_add_text(item, "tensor", tensor);
	dio_json_add_number(item, "db", isfinite(all_db) ? all_db : 999, 2);
	dio_json_add_number(item, "worst_row_db", isfinite(worst_row_db) ? worst_row_db : 999, 2);
	cJSON_AddItemToArray(job->matrices, item);
}

/* ---- activations, on scenes that the caller names ---- */

#define FIGURES 5
static const char *const figure_names[FIGURES] = {"keys", "values", "attention", "hidden",
						  "output"};

struct layer_figures {
	double db[FIGURES]; /* worst of all scenes; NaN for none */
};

static void worsen(struct layer_figures *worst, const struct dvsm_half_error *error)
{
	const double found[FIGURES] = {error->keys_db, error->values_db, error->attention_db,
				       error->hidden_db, error->output_db};

	for (int f = 0; f < FIGURES; f++)
		worst->db[f] = fmin(worst->db[f], found[f]); /* of which a NaN loses */
}

static enum dio_status compare_scene(struct dio_session *session, const char *path,
				     struct layer_figures *worst, uint32_t halves,
				     struct dio_error *error)
{
	struct dio_scene_file file = {0};
	struct dio_view_set set = {0};
	struct dvsm_half_error *errors = calloc(halves, sizeof *errors);
	enum dio_status status;

	if (!errors)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
	if ((status = dio_scene_file_read(path, &file, error)) == DIO_OK &&
	    (status = dio_view_set_load(&file, DIO_LOAD_CONTEXT, &set, error)) == DIO_OK)
		status = dio_session_compare(session, &set, errors, error);
	for (uint32_t i = 0; status == DIO_OK && i < halves; i++)
		worsen(&worst[i], &errors[i]);
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&file);
	free(errors);
	return status;
}

static const char *half_name(uint32_t half)
{
	return half % 2 ? "cross" : "intra";
}

static void print_layers(const struct layer_figures *layers, uint32_t halves)
{
	uint32_t worst = 0;
	int what = 0;

	printf("%-16s", "against float32");
	for (int f = 0; f < FIGURES; f++)
		printf(" %9s", figure_names[f]);
	printf("\n");
	for (uint32_t i = 0; i < halves; i++) {
		printf("block %-3u %-6s", i / 2, half_name(i));
		for (int f = 0; f < FIGURES; f++) {
			double db = layers[i].db[f];

			if (isnan(db))
				printf(" %9s", "-");
			else
				printf(" %6.1f dB", db);
			if (db < layers[worst].db[what] || isnan(layers[worst].db[what])) {
				worst = i;
				what = f;
			}
		}
		printf("\n");
	}
	printf("worst: %s of block %u, %s: %.1f dB\n", figure_names[what], worst / 2,
	       half_name(worst), layers[worst].db[what]);
}

static cJSON *layers_json(const struct layer_figures *layers, uint32_t halves)
{
	cJSON *list = cJSON_CreateArray();

	for (uint32_t i = 0; i < halves; i++) {
		cJSON *item = cJSON_CreateObject();

		cJSON_AddNumberToObject(item, "block", i / 2);
		dio_json_add_text(item, "half", half_name(i));
		for (int f = 0; f < FIGURES; f++) {
			char name[32];

			snprintf(name, sizeof name, "%s_db", figure_names[f]);
			if (!isnan(layers[i].db[f]))
				dio_json_add_number(item, name, fmin(layers[i].db[f], 999), 2);
		}
		cJSON_AddItemToArray(list, item);
	}
	return list;
}

/* Scenes are a list with commas. */
static enum dio_status compare_scenes(struct quantize_job *job, struct dio_error *error)
{
	const struct dio_session_options options = {.model = job->model};
	struct dio_session *session = NULL;
	struct layer_figures *worst = NULL;
	char *paths = strdup(job->calibration), *rest = paths, *path;
	enum dio_status status = dio_session_open(&options, &session, error);
	uint32_t halves = 0;

	if (status == DIO_OK) {
		halves = 2 * dvsm_model_get_config(dio_session_get_model(session))->layers;
		worst = calloc(halves, sizeof *worst);
	}
	if (status == DIO_OK && (!paths || !worst))
		status = dio_fail(error, DIO_NO_MEM, "no memory to compare precisions");
	for (uint32_t i = 0; status == DIO_OK && i < halves * FIGURES; i++)
		worst[i / FIGURES].db[i % FIGURES] = NAN;
	while (status == DIO_OK && (path = strsep(&rest, ",")))
		status = compare_scene(session, path, worst, halves, error);
	if (status == DIO_OK && job->json)
		job->layers = layers_json(worst, halves);
	else if (status == DIO_OK)
		print_layers(worst, halves);
	dio_session_close(session);
	free(worst);
	free(paths);
	return status;
}

static enum dio_status write_model(struct quantize_job *job, struct dio_error *error)
{
	struct dvsm_error fault = {0};
	struct dvsm_model *model = NULL;
	enum dvsm_status status = dvsm_model_open(job->model, &model, &fault);

	if (status == DVSM_OK)
		status = dvsm_model_quantise(model, job->out,
					     job->report || job->json ? report_matrix : NULL, job,
					     &fault);
	dvsm_model_close(model);
	return dio_status_from_engine(status, &fault, error);
}

static enum dio_status quantize(struct quantize_job *job, struct dio_error *error)
{
	enum dio_status status;
	cJSON *root;

	if (job->json)
		job->matrices = cJSON_CreateArray();
	status = write_model(job, error);
	if (status == DIO_OK && job->calibration)
		status = compare_scenes(job, error);
	if (status != DIO_OK) {
		cJSON_Delete(job->matrices);
		return status;
	}
	if (!job->json) {
		printf("wrote %s\n", job->out);
		return DIO_OK;
	}
	root = cJSON_CreateObject();
	dio_json_add_text(root, "out", job->out);
	cJSON_AddItemToObject(root, "matrices", job->matrices);
	if (job->layers)
		cJSON_AddItemToObject(root, "layers", job->layers);
	return dio_json_print(root, error);
}

int dio_command_quantize(int argc, char **argv)
{
	struct quantize_job job = {0};
	struct dio_error error = {""};
	char **arguments;
	uint32_t count;
	const struct dio_option options[] = {
		{"out", DIO_OPTION_TEXT, "FILE", "the quantised model to write (.safetensors)",
		 &job.out, 0, 0, true},
		{"report", DIO_OPTION_FLAG, NULL,
		 "print how far each matrix is from its weights: 10 log10 of the\n"
		 "weights' squares over the errors'",
		 &job.report, 0, 0, false},
		{"calibration", DIO_OPTION_TEXT, "SCENE[,SCENE...]",
		 "run these scenes (scene.json) in float32 and in fixed and print how\n"
		 "far each layer's keys, values, attention, hidden numbers and output\n"
		 "are apart, the worst of all scenes; the file stays the same",
		 &job.calibration, 0, 0, false},
		{"json", DIO_OPTION_FLAG, NULL, "the report as JSON", &job.json, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "quantize",
		.summary = "write a model in int8, a scale for each row",
		.arguments = "MODEL",
		.details =
			"Not needed for --precision fixed, which quantises any model when it is "
			"read and gives\nthe same pictures; the file is a quarter of the size of "
			"float32.",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	job.model = arguments[0];
	if (quantize(&job, &error) != DIO_OK) {
		dio_log_error("quantize: %s", error.text);
		return DIO_EXIT_FAILED;
	}
	return DIO_EXIT_OK;
}
