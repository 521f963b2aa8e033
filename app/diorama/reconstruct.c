/* reconstruct: posed pictures to a scene file (the KV-cache). */
#include <stdio.h>

#include "commands.h"
#include "core/json_out.h"
#include "core/options.h"
#include "engine_options.h"
#include "report.h"

struct reconstruct_job {
	struct dio_session_options session;
	const char *scene, *out;
	bool json;
};

static enum dio_status print_json(const struct reconstruct_job *job,
				  const struct dio_session *session, const struct dvsm_stats *stats,
				  struct dio_error *error)
{
	const struct dvsm_scene *scene = dio_session_get_scene(session);
	cJSON *root = cJSON_CreateObject();

	dio_json_add_text(root, "scene_cache", job->out);
	dio_json_add_text(root, "model", dio_session_get_model_path(session));
	cJSON_AddNumberToObject(root, "views", dvsm_scene_get_view_count(scene));
	cJSON_AddNumberToObject(root, "tokens", (double)dvsm_scene_get_token_count(scene));
	cJSON_AddNumberToObject(root, "patch_recon", dvsm_scene_get_patch_px(scene));
	dio_json_add_number(root, "reconstruct_ms", (double)stats->time_ns * 1e-6, 3);
	dio_json_add_text(root, "cpu", dvsm_engine_get_cpu(dio_session_get_engine(session)));
	cJSON_AddNumberToObject(root, "threads",
				dvsm_engine_get_threads(dio_session_get_engine(session)));
	dio_json_add_text(
		root, "precision",
		dvsm_precision_name(dvsm_engine_get_precision(dio_session_get_engine(session))));
	cJSON_AddItemToObject(root, "memory", dio_report_memory(&stats->memory));
	return dio_json_print(root, error);
}

static void print_text(const struct reconstruct_job *job, const struct dio_session *session,
		       const struct dvsm_stats *stats)
{
	const struct dvsm_scene *scene = dio_session_get_scene(session);
	char cache[32], weights[32], workspace[32];

	printf("%s: %u views, %llu tokens (patch %u), %.1f ms\n", job->out,
	       dvsm_scene_get_view_count(scene),
	       (unsigned long long)dvsm_scene_get_token_count(scene),
	       dvsm_scene_get_patch_px(scene), (double)stats->time_ns * 1e-6);
	printf("memory: weights %s, cache %s, workspace %s\n",
	       dio_report_bytes(stats->memory.weights_bytes, weights, sizeof weights),
	       dio_report_bytes(stats->memory.cache_bytes, cache, sizeof cache),
	       dio_report_bytes(stats->memory.workspace_bytes, workspace, sizeof workspace));
}

static enum dio_status reconstruct(const struct reconstruct_job *job, struct dio_error *error)
{
	struct dio_scene_file file = {0};
	struct dio_view_set set = {0};
	struct dio_session *session = NULL;
	struct dvsm_stats stats = {0};
	enum dio_status status;

	if ((status = dio_scene_file_read(job->scene, &file, error)) != DIO_OK ||
	    (status = dio_view_set_load(&file, DIO_LOAD_CONTEXT, &set, error)) != DIO_OK ||
	    (status = dio_session_open(&job->session, &session, error)) != DIO_OK)
		goto out;
	dio_report_engine(session);
	if ((status = dio_session_reconstruct(session, set.context, set.context_count, &stats,
					      error)) != DIO_OK ||
	    (status = dio_session_save_scene(session, job->out, error)) != DIO_OK)
		goto out;
	if (job->json)
		status = print_json(job, session, &stats, error);
	else
		print_text(job, session, &stats);
out:
	dio_session_close(session);
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&file);
	return status;
}

int dio_command_reconstruct(int argc, char **argv)
{
	struct reconstruct_job job = {0};
	const struct dio_option options[] = {
		DIO_OPTION_MODEL(job.session),
		{"scene", DIO_OPTION_TEXT, "FILE", "scene.json with posed pictures", &job.scene, 0,
		 0, true},
		{"out", DIO_OPTION_TEXT, "FILE", "the scene cache to write (.scene.safetensors)",
		 &job.out, 0, 0, true},
		DIO_OPTION_PATCH_RECON(job.session),
		DIO_OPTION_THREADS(job.session),
		DIO_OPTION_CPU(job.session),
		DIO_OPTION_PRECISION(job.session),
		{"json", DIO_OPTION_FLAG, NULL, "results as JSON", &job.json, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "reconstruct",
		.summary = "turn posed pictures into a scene (a KV-cache)",
		.arguments = "",
		.details = DIO_HELP_PATCH,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	char **arguments;
	uint32_t count;
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	if (reconstruct(&job, &error) != DIO_OK)
		return dio_report_failure(usage.command, &error);
	return DIO_EXIT_OK;
}
