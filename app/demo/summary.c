#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#include "core/json_out.h"
#include "demo/state.h"
#include "dio/atomic_file.h"

/* Peak memory of this process. */
static double peak_mib(void)
{
	struct rusage usage;

	return getrusage(RUSAGE_SELF, &usage) == 0 ? (double)usage.ru_maxrss / 1024 : 0;
}

static double total_seconds(const struct dio_demo *demo)
{
	double sum = 0;

	for (uint32_t i = 0; i < demo->stage_count; i++)
		sum += demo->stages[i].seconds;
	return sum;
}

static void write_head(const struct dio_demo *demo, FILE *out)
{
	const struct dvsm_engine *engine = dio_session_get_engine(demo->session);

	fputs("# Diorama demo\n\n", out);
	if (demo->options->input)
		fprintf(out, "Pictures: %s, board %s.\n", demo->options->input,
			demo->options->board);
	else
		fprintf(out, "Pictures: the simulated camera, seed %u, board %s.\n",
			demo->options->seed, demo->options->board);
	fprintf(out, "Model: %s, %u threads, %s.\n\n", dio_session_get_model_path(demo->session),
		dvsm_engine_get_threads(engine), dvsm_engine_get_cpu(engine));
}

static void write_stages(const struct dio_demo *demo, FILE *out)
{
	fputs("| stage | time | result |\n|---|---|---|\n", out);
	for (uint32_t i = 0; i < demo->stage_count; i++)
		fprintf(out, "| %s | %.2f s | %s |\n", demo->stages[i].name,
			demo->stages[i].seconds, demo->stages[i].result);
	fprintf(out, "| all | %.2f s | peak memory %.0f MiB |\n\n", total_seconds(demo),
		peak_mib());
}

static void write_camera(const struct dio_demo *demo, FILE *out)
{
	const struct dio_calibration *c = &demo->calibrating.calibration;
	const struct dio_demo_truth *t = &demo->truth;

	fputs("## Camera\n\n", out);
	fprintf(out, "fx %.2f +- %.2f, fy %.2f +- %.2f, cx %.2f +- %.2f, cy %.2f +- %.2f px; ",
		c->model.fx, c->sigma_fx, c->model.fy, c->sigma_fy, c->model.cx, c->sigma_cx,
		c->model.cy, c->sigma_cy);
	fprintf(out, "corners reach %.0f %% of the picture, tilt %.0f degrees.\n\n",
		c->coverage * 100, c->tilt_deg);
	if (!t->known) {
		fputs("The true camera and poses of photos are not known: there is nothing to "
		      "compare with.\n\n",
		      out);
		return;
	}
	fputs("## Against the truth\n\n| estimate | error |\n|---|---|\n", out);
	fprintf(out, "| fx, fy | %+.3f, %+.3f px |\n", t->fx_px, t->fy_px);
	fprintf(out, "| cx, cy | %+.3f, %+.3f px |\n", t->cx_px, t->cy_px);
	fprintf(out, "| where a ray lands, lens included | mean %.3f, largest %.3f px |\n",
		t->ray_mean_px, t->ray_max_px);
	fprintf(out, "| position of %u poses | mean %.2f, largest %.2f mm |\n", t->poses,
		t->position_mean_mm, t->position_max_mm);
	fprintf(out, "| rotation of %u poses | mean %.3f, largest %.3f degrees |\n\n", t->poses,
		t->rotation_mean_deg, t->rotation_max_deg);
}

static void write_pictures(const struct dio_demo *demo, FILE *out)
{
	const struct dio_evaluation *eval = &demo->evaluation;

	fprintf(out, "## Held-back viewpoints\n\n| picture | rendered | nearest view "
		     "|\n|---|---|---|\n");
	for (uint32_t i = 0; i < eval->count; i++) {
		const struct dio_score *s = &eval->scores[i];

		fprintf(out, "| %s | %.2f dB, SSIM %.3f | %.2f dB, SSIM %.3f |\n",
			demo->set.target[s->target].name, s->psnr_db, s->ssim, s->nearest_psnr_db,
			s->nearest_ssim);
	}
	fprintf(out, "| mean | %.2f dB, SSIM %.3f | %.2f dB, SSIM %.3f |\n\n", eval->psnr_db,
		eval->ssim, eval->nearest_psnr_db, eval->nearest_ssim);
	fputs("Files: sheet.png (inputs, rendered, true, orbit), orbit.mp4, camera.yaml, "
	      "scene.json "
	      "with images/, scene.safetensors (the reconstructed scene), summary.json.\n",
	      out);
}

static enum dio_status write_text(const struct dio_demo *demo, struct dio_error *error)
{
	struct dio_atomic_file *file = NULL;
	char *path = dio_demo_path(demo, "summary.md");
	enum dio_status status = path ? dio_atomic_file_open(path, &file, error)
				      : dio_fail(error, DIO_NO_MEM, "no memory for the summary");

	free(path);
	if (status != DIO_OK)
		return status;
	write_head(demo, dio_atomic_file_stream(file));
	write_stages(demo, dio_atomic_file_stream(file));
	write_camera(demo, dio_atomic_file_stream(file));
	write_pictures(demo, dio_atomic_file_stream(file));
	return dio_atomic_file_commit(file, error);
}

static cJSON *stages_json(const struct dio_demo *demo)
{
	cJSON *list = cJSON_CreateArray();

	for (uint32_t i = 0; i < demo->stage_count; i++) {
		cJSON *item = cJSON_CreateObject();

		dio_json_add_text(item, "stage", demo->stages[i].name);
		dio_json_add_number(item, "seconds", demo->stages[i].seconds, 4);
		dio_json_add_text(item, "result", demo->stages[i].result);
		cJSON_AddItemToArray(list, item);
	}
	return list;
}

/* null where there is nothing to compare with. */
static cJSON *truth_json(const struct dio_demo_truth *t)
{
	cJSON *item = t->known ? cJSON_CreateObject() : cJSON_CreateNull();

	if (!t->known)
		return item;
	dio_json_add_number(item, "fx_error_px", t->fx_px, 4);
	dio_json_add_number(item, "fy_error_px", t->fy_px, 4);
	dio_json_add_number(item, "cx_error_px", t->cx_px, 4);
	dio_json_add_number(item, "cy_error_px", t->cy_px, 4);
	dio_json_add_number(item, "ray_mean_px", t->ray_mean_px, 4);
	dio_json_add_number(item, "ray_max_px", t->ray_max_px, 4);
	dio_json_add_number(item, "poses", t->poses, 0);
	dio_json_add_number(item, "position_mean_mm", t->position_mean_mm, 4);
	dio_json_add_number(item, "position_max_mm", t->position_max_mm, 4);
	dio_json_add_number(item, "rotation_mean_deg", t->rotation_mean_deg, 5);
	dio_json_add_number(item, "rotation_max_deg", t->rotation_max_deg, 5);
	return item;
}

static cJSON *pictures_json(const struct dio_demo *demo)
{
	const struct dio_evaluation *eval = &demo->evaluation;
	cJSON *item = cJSON_CreateObject();

	dio_json_add_number(item, "targets", eval->count, 0);
	dio_json_add_number(item, "psnr_db", eval->psnr_db, 3);
	dio_json_add_number(item, "ssim", eval->ssim, 4);
	dio_json_add_number(item, "nearest_psnr_db", eval->nearest_psnr_db, 3);
	dio_json_add_number(item, "nearest_ssim", eval->nearest_ssim, 4);
	dio_json_add_number(item, "reconstruct_ms", (double)eval->reconstruct.time_ns * 1e-6, 3);
	dio_json_add_number(item, "render_ms", (double)eval->render_ns * 1e-6, 3);
	return item;
}

static cJSON *summary_json(const struct dio_demo *demo)
{
	cJSON *root = cJSON_CreateObject();

	if (!root)
		return NULL;
	dio_json_add_text(root, "input", demo->options->input ? demo->options->input : demo->walk);
	dio_json_add_text(root, "board", demo->options->board);
	dio_json_add_text(root, "model", dio_session_get_model_path(demo->session));
	cJSON_AddItemToObject(root, "stages", stages_json(demo));
	dio_json_add_number(root, "seconds", total_seconds(demo), 3);
	dio_json_add_number(root, "peak_memory_mib", peak_mib(), 1);
	dio_json_add_number(root, "posed", demo->posing.posed, 0);
	dio_json_add_number(root, "pictures", demo->posing.count, 0);
	dio_json_add_number(root, "calibration_rms_px", demo->calibrating.calibration.rms_px, 4);
	dio_json_add_number(root, "calibration_heldout_rms_px",
			    demo->calibrating.calibration.heldout_rms_px, 4);
	cJSON_AddItemToObject(root, "truth", truth_json(&demo->truth));
	cJSON_AddItemToObject(root, "rendered", pictures_json(demo));
	return root;
}

enum dio_status dio_demo_write_summary(const struct dio_demo *demo, char **json,
				       struct dio_error *error)
{
	char *path = dio_demo_path(demo, "summary.json");
	cJSON *root = summary_json(demo);
	enum dio_status status = write_text(demo, error);

	if (status == DIO_OK && (!path || !root))
		status = dio_fail(error, DIO_NO_MEM, "no memory for the summary");
	if (status == DIO_OK)
		status = dio_json_write(root, path, error);
	if (status == DIO_OK && json) {
		*json = cJSON_Print(root);
		if (!*json)
			status = dio_fail(error, DIO_NO_MEM, "no memory for the summary");
	}
	cJSON_Delete(root);
	free(path);
	return status;
}
