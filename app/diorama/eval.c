/* eval: rendered targets against their true pictures, beside the nearest-view baseline. */
#include <stdio.h>

#include "commands.h"
#include "core/evaluate.h"
#include "core/json_out.h"
#include "core/options.h"
#include "engine_options.h"
#include "report.h"

struct eval_job {
	struct dio_session_options session;
	const char *scene;
	bool json;
};

static void add_scores(cJSON *object, double psnr_db, double ssim, double nearest_psnr_db,
		       double nearest_ssim)
{
	dio_json_add_number(object, "psnr_db", psnr_db, 4);
	dio_json_add_number(object, "ssim", ssim, 5);
	dio_json_add_number(object, "nearest_psnr_db", nearest_psnr_db, 4);
	dio_json_add_number(object, "nearest_ssim", nearest_ssim, 5);
}

static enum dio_status print_json(const char *name, const struct dio_view_set *set,
				  const struct dio_session *session,
				  const struct dio_evaluation *evaluation, struct dio_error *error)
{
	cJSON *root = cJSON_CreateObject(), *targets;

	dio_json_add_text(root, "scene", name);
	dio_json_add_text(root, "model", dio_session_get_model_path(session));
	cJSON_AddNumberToObject(root, "context_views", set->context_count);
	cJSON_AddNumberToObject(root, "patch_recon",
				dvsm_scene_get_patch_px(dio_session_get_scene(session)));
	cJSON_AddBoolToObject(root, "deblock", dio_session_get_deblock(session));
	add_scores(root, evaluation->psnr_db, evaluation->ssim, evaluation->nearest_psnr_db,
		   evaluation->nearest_ssim);
	dio_json_add_number(root, "reconstruct_ms", (double)evaluation->reconstruct.time_ns * 1e-6,
			    3);
	dio_json_add_number(root, "render_ms", (double)evaluation->render_ns * 1e-6, 3);
	dio_json_add_text(root, "cpu", dvsm_engine_get_cpu(dio_session_get_engine(session)));
	cJSON_AddNumberToObject(root, "threads",
				dvsm_engine_get_threads(dio_session_get_engine(session)));
	dio_json_add_text(
		root, "precision",
		dvsm_precision_name(dvsm_engine_get_precision(dio_session_get_engine(session))));
	cJSON_AddItemToObject(root, "memory", dio_report_memory(&evaluation->reconstruct.memory));
	targets = cJSON_AddArrayToObject(root, "targets");
	for (uint32_t i = 0; i < evaluation->count; i++) {
		const struct dio_score *score = &evaluation->scores[i];
		cJSON *target = cJSON_CreateObject();

		dio_json_add_text(target, "name", set->target[score->target].name);
		dio_json_add_text(target, "nearest", set->context[score->nearest].name);
		add_scores(target, score->psnr_db, score->ssim, score->nearest_psnr_db,
			   score->nearest_ssim);
		dio_json_add_number(target, "render_ms", (double)score->render_ns * 1e-6, 3);
		cJSON_AddItemToArray(targets, target);
	}
	return dio_json_print(root, error);
}

static void print_text(const char *name, const struct dio_view_set *set,
		       const struct dio_session *session, const struct dio_evaluation *evaluation)
{
	const struct dio_score *last = &evaluation->scores[evaluation->count - 1];

	printf("%-20s %10s %7s   %10s %7s   %9s\n", "target", "PSNR dB", "SSIM", "nearest dB",
	       "SSIM", "render ms");
	for (const struct dio_score *score = evaluation->scores; score <= last; score++)
		printf("%-20s %10.2f %7.3f   %10.2f %7.3f   %9.1f\n",
		       set->target[score->target].name, score->psnr_db, score->ssim,
		       score->nearest_psnr_db, score->nearest_ssim,
		       (double)score->render_ns * 1e-6);
	printf("%-20s %10.2f %7.3f   %10.2f %7.3f   %9.1f\n", "mean", evaluation->psnr_db,
	       evaluation->ssim, evaluation->nearest_psnr_db, evaluation->nearest_ssim,
	       (double)evaluation->render_ns * 1e-6);
	printf("scene %s: %u context views reconstructed in %.1f ms (patch %u; rendering patch "
	       "%u%s)\n",
	       name, set->context_count, (double)evaluation->reconstruct.time_ns * 1e-6,
	       dvsm_scene_get_patch_px(dio_session_get_scene(session)),
	       dio_session_get_patch_render(session, &set->target[last->target].camera),
	       dio_session_get_deblock(session) ? ", deblocked" : "");
}

static enum dio_status evaluate(const struct eval_job *job, struct dio_error *error)
{
	struct dio_scene_file file = {0};
	struct dio_view_set set = {0};
	struct dio_session *session = NULL;
	struct dio_evaluation evaluation = {0};
	enum dio_status status;

	if ((status = dio_scene_file_read(job->scene, &file, error)) != DIO_OK ||
	    (status = dio_view_set_load(&file, DIO_LOAD_ALL, &set, error)) != DIO_OK ||
	    (status = dio_session_open(&job->session, &session, error)) != DIO_OK)
		goto out;
	dio_report_engine(session);
	status = dio_evaluate(session, &set, &evaluation, error);
	if (status != DIO_OK)
		goto out;
	if (job->json)
		status = print_json(file.name, &set, session, &evaluation, error);
	else
		print_text(file.name, &set, session, &evaluation);
out:
	dio_evaluation_deinit(&evaluation);
	dio_session_close(session);
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&file);
	return status;
}

int dio_command_eval(int argc, char **argv)
{
	struct eval_job job = {0};
	const struct dio_option options[] = {
		DIO_OPTION_MODEL(job.session),
		{"scene", DIO_OPTION_TEXT, "FILE", "scene.json with targets that have a picture",
		 &job.scene, 0, 0, true},
		DIO_OPTION_PATCH_RECON(job.session),
		DIO_OPTION_PATCH_RENDER(job.session),
		DIO_OPTION_THREADS(job.session),
		DIO_OPTION_CPU(job.session),
		DIO_OPTION_PRECISION(job.session),
		DIO_OPTION_DEBLOCKING(job.session),
		{"json", DIO_OPTION_FLAG, NULL, "results as JSON", &job.json, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "eval",
		.summary = "score rendered targets against their true pictures",
		.arguments = "",
		.details =
			"PSNR is over all pixels and channels of the 8-bit picture; SSIM on luma, "
			"11x11 Gaussian,\nsigma 1.5. `nearest` is the context picture whose camera "
			"is nearest, unchanged: what a\nrenderer has to beat.\n\n" DIO_HELP_PATCH,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	char **arguments;
	uint32_t count;
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	if (evaluate(&job, &error) != DIO_OK)
		return dio_report_failure(usage.command, &error);
	return DIO_EXIT_OK;
}
