/* quantize: a model in int8, and what that costs each matrix. */
#include <math.h>
#include <stdio.h>

#include "commands.h"
#include "core/json_out.h"
#include "core/log.h"
#include "core/model_choice.h"
#include "core/options.h"
#include "core/session.h"

struct quantize_job {
	const char *model, *out;
	bool report, json;
	cJSON *matrices;
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

static enum dio_status quantize(struct quantize_job *job, struct dio_error *error)
{
	struct dvsm_error fault = {0};
	struct dvsm_model *model = NULL;
	enum dvsm_status status = dvsm_model_open(job->model, &model, &fault);
	cJSON *root;

	if (job->json)
		job->matrices = cJSON_CreateArray();
	if (status == DVSM_OK)
		status = dvsm_model_quantise(model, job->out,
					     job->report || job->json ? report_matrix : NULL, job,
					     &fault);
	dvsm_model_close(model);
	if (status != DVSM_OK) {
		cJSON_Delete(job->matrices);
		return dio_status_from_engine(status, &fault, error);
	}
	if (!job->json) {
		printf("wrote %s\n", job->out);
		return DIO_OK;
	}
	root = cJSON_CreateObject();
	dio_json_add_text(root, "out", job->out);
	cJSON_AddItemToObject(root, "matrices", job->matrices);
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
