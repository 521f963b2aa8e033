/* bench: time, memory and error on this machine, for every precision, patch, views and threads. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/plot.h"
#include "bench/report.h"
#include "commands.h"
#include "core/json_out.h"
#include "core/model_choice.h"
#include "core/options.h"
#include "core/path.h"
#include "engine_options.h"
#include "report.h"

#define VIEWS_MAX 1024

struct bench_job {
	struct dio_session_options session; /* model and cpu_mask */
	const char *config, *scene;
	const char *precisions, *patches, *views, *threads; /* lists */
	const char *reference, *save, *json, *plot;
	uint32_t runs;
};

static void say(const void *context, const struct dio_outcome *outcome,
		const struct dio_measured *measured)
{
	if (outcome->count == 1)
		dio_report_print_head(context, outcome);
	dio_report_print_row(outcome, measured);
}

static uint32_t most(const struct dio_list *list)
{
	uint32_t value = 0;

	for (uint32_t i = 0; i < list->count; i++)
		value = list->values[i] > value ? list->values[i] : value;
	return value;
}

/* The stage patch a user of this model and scene would get. */
static void choose_patch(const struct dio_work *work, struct dio_list *patches)
{
	const struct dio_camera_model *camera = &work->views.target[0].camera;

	patches->count = 1;
	patches->values[0] = dio_model_choose_patch(
		work->card.tokens_per_view, work->config.patch_px, camera->width, camera->height);
}

/* Lists that need neither model nor scene; those the user left out follow the size drawn. */
static enum dio_status read_lists(const struct bench_job *job, const struct dio_draw_size *size,
				  const struct dio_machine *machine, struct dio_sweep *sweep,
				  struct dio_error *error)
{
	const char *patches = job->patches                       ? job->patches
			      : job->session.model || job->scene ? NULL
								 : size->patches;
	const char *views = job->views ? job->views : job->scene ? NULL : size->views;
	enum dio_status status;

	status = dio_list_parse_precisions(job->precisions ? job->precisions : "f32,bf16,fixed",
					   &sweep->precisions, error);
	if (status == DIO_OK && patches)
		status = dio_list_parse(patches, "patch", 1, 256, &sweep->patches, error);
	if (status == DIO_OK && views)
		status = dio_list_parse(views, "views", 1, VIEWS_MAX, &sweep->views, error);
	if (status == DIO_OK && job->threads)
		status = dio_list_parse(job->threads, "threads", 1, 256, &sweep->threads, error);
	if (!job->threads) {
		sweep->threads.values[sweep->threads.count++] = 1;
		if (machine->processors > 1)
			sweep->threads.values[sweep->threads.count++] = machine->processors;
	}
	return status;
}

/* What the work itself decides or limits. */
static enum dio_status complete(const struct bench_job *job, const struct dio_work *work,
				struct dio_sweep *sweep, struct dio_error *error)
{
	const uint32_t context = work->views.context_count;

	if (sweep->patches.count == 0)
		choose_patch(work, &sweep->patches);
	if (sweep->views.count == 0) {
		sweep->views.count = 1;
		sweep->views.values[0] = context;
	}
	if (most(&sweep->views) > context)
		return dio_fail(error, DIO_BAD_ARG, "--views %u: %s has %u context views",
				most(&sweep->views), work->scene_name, context);
	if (job->plot && !job->reference && work->pictures == 0)
		return dio_fail(error, DIO_BAD_ARG,
				"--plot needs an error to show: give --reference, or a --scene "
				"whose targets have pictures");
	return DIO_OK;
}

static enum dio_status measure(const struct bench_job *job, struct dio_work *work,
			       const struct dio_report *report, struct dio_error *error)
{
	struct dio_outcome outcome = {0};
	enum dio_status status = dio_sweep_run(work, report->sweep, say, report, &outcome, error);
	cJSON *root;

	if (status == DIO_OK && job->json) {
		root = dio_report_json(report, &outcome);
		status = dio_json_write(root, job->json, error);
		cJSON_Delete(root);
	}
	if (status == DIO_OK && job->plot)
		status = dio_plot_write(report, &outcome, job->plot, error);
	dio_outcome_deinit(&outcome);
	return status;
}

static enum dio_status bench(struct bench_job *job, struct dio_error *error)
{
	const struct dio_draw_size *size = dio_draw_find(job->config);
	struct dio_sweep sweep = {.cpu_mask = job->session.cpu_mask,
				  .reference = job->reference,
				  .any_precision = !job->precisions};
	struct dio_work work = {0};
	struct dio_machine machine;
	char *shipped = NULL;
	enum dio_status status;

	dio_machine_describe(&machine);
	if (!size)
		return dio_fail(error, DIO_BAD_ARG, "--config %s: small or paper is wanted",
				job->config);
	sweep.runs = job->runs ? job->runs : size->runs;
	status = read_lists(job, size, &machine, &sweep, error);
	/* Drawn weights make nothing of true pictures. */
	if (status == DIO_OK && job->scene && !job->session.model) {
		status = dio_model_find_shipped(&shipped, error);
		job->session.model = shipped;
	}
	if (status == DIO_OK)
		status = dio_work_open(size, job->session.model, sweep.precisions.values[0],
				       job->scene, most(&sweep.views), &work, error);
	if (status == DIO_OK)
		status = complete(job, &work, &sweep, error);
	if (status == DIO_OK && job->save) {
		status = dio_work_save(&work, size, !job->session.model, sweep.views.values,
				       sweep.views.count, job->save, error);
	} else if (status == DIO_OK) {
		const struct dio_report report = {&machine, &work, &sweep};

		status = measure(job, &work, &report, error);
	}
	dio_work_deinit(&work);
	free(shipped);
	return status;
}

int dio_command_bench(int argc, char **argv)
{
	struct bench_job job = {.config = "small"};
	const struct dio_option options[] = {
		{"model", DIO_OPTION_TEXT, "FILE",
		 "weights, safetensors (default: drawn at random, the same every\n"
		 "time; with --scene the shipped model)",
		 &job.session.model, 0, 0, false},
		{"config", DIO_OPTION_TEXT, "NAME",
		 "sizes of what is drawn: small (D 384, 6 heads, 8 blocks, patch 8,\n"
		 "128x128) or paper (D 768, 12 heads, 12 blocks, patch 16, 960x540)\n"
		 "(default: small)",
		 &job.config, 0, 0, false},
		{"scene", DIO_OPTION_TEXT, "FILE",
		 "scene.json with targets (default: pictures and cameras are drawn)", &job.scene, 0,
		 0, false},
		{"precision", DIO_OPTION_TEXT, "LIST",
		 "of f32, bf16, fixed (default: all there are)", &job.precisions, 0, 0, false},
		{"patch", DIO_OPTION_TEXT, "LIST", "stage patches in pixels, as in 8,16",
		 &job.patches, 0, 0, false},
		{"views", DIO_OPTION_TEXT, "LIST", "numbers of context views", &job.views, 0, 0,
		 false},
		{"threads", DIO_OPTION_TEXT, "LIST",
		 "numbers of threads (default: 1 and all cores)", &job.threads, 0, 0, false},
		DIO_OPTION_CPU(job.session),
		{"runs", DIO_OPTION_COUNT, "N",
		 "runs of each stage after one to warm up (default: 7, paper 3);\n"
		 "after ten seconds three are enough",
		 &job.runs, 1, DIO_RUNS_MAX, false},
		{"reference", DIO_OPTION_TEXT, "DIR",
		 "what float64 makes of it: DIR/vV_pP.npy for V views and patch P,\n"
		 "[targets][height][width][3]",
		 &job.reference, 0, 0, false},
		{"json", DIO_OPTION_TEXT, "FILE", "write all figures as JSON too", &job.json, 0, 0,
		 false},
		{"plot", DIO_OPTION_TEXT, "FILE", "draw run time against error as SVG", &job.plot,
		 0, 0, false},
		{"save", DIO_OPTION_TEXT, "DIR",
		 "measure nothing; leave model.safetensors (when drawn) and\n"
		 "vV/scene.json there, so that other programs can do the same work",
		 &job.save, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "bench",
		.summary = "measure time, memory and error on this machine",
		.arguments = "",
		.details =
			"Shares of the peak are of what this machine's multiply instructions do in "
			"a loop that\nwaits for nothing, measured first. Errors are over all "
			"targets, 1 = white: against\nfloat64 with --reference, against the true "
			"pictures with a --scene that has them. Pictures are\nthe model's own, not "
			"deblocked.",
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	char **arguments;
	uint32_t count;
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	if (bench(&job, &error) != DIO_OK)
		return dio_report_failure(usage.command, &error);
	return DIO_EXIT_OK;
}
