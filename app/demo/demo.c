#include "demo/demo.h"

#include <ftw.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/path.h"
#include "core/scene_file.h"
#include "demo/state.h"
#include "dio/clock.h"

/* The simulated hand rests at a new place each 1.5 s of the dance, and goes once round the table
 * in 40 s of the walk. */
#define DANCE_FPS (1 / 1.5)
#define WALK_S    40.0

#define SIM_CAMERA "sim:table?style=%s&seed=%u&width=%u&height=%u&board=%s"
#define SIM_WIDTH  640u
#define SIM_HEIGHT 480u

void dio_demo_defaults(struct dio_demo_options *options)
{
	*options = (struct dio_demo_options){
		.board = "charuco:10x7:0.0285:0.0171:DICT_6X6_250",
		.out = "demo-out",
		.seed = 6,
		.stands = 30,
		.frames = 40,
		.context = 8,
		.orbit_frames = 100,
	};
}

/* Note a stage that is over and say so. */
__attribute__((format(printf, 4, 5))) static void finish(struct dio_demo *demo, const char *name,
							 double seconds, const char *format, ...)
{
	struct dio_demo_stage *stage = &demo->stages[demo->stage_count++];
	va_list arguments;

	stage->name = name;
	stage->seconds = seconds;
	va_start(arguments, format);
	vsnprintf(stage->result, sizeof stage->result, format, arguments);
	va_end(arguments);
	if (demo->options->quiet)
		return;
	printf("%-12s %6.2f s  %s\n", name, seconds, stage->result);
	fflush(stdout);
}

static double seconds_since(uint64_t start_ns)
{
	return (double)(dio_clock_ns() - start_ns) * 1e-9;
}

static enum dio_status calibrate(struct dio_demo *demo, struct dio_error *error)
{
	const struct dio_calibration *c = &demo->calibrating.calibration;
	struct dio_calibrating_options options;
	uint64_t start = dio_clock_ns();
	char *file = dio_demo_path(demo, "camera.yaml");
	struct dio_board board;
	enum dio_status status = dio_board_parse(demo->options->board, &board, error);

	dio_calibrating_defaults(&options);
	options.gather.views = demo->options->stands;
	if (!demo->options->input)
		options.camera.frames_per_second = DANCE_FPS;
	if (status == DIO_OK)
		status = dio_calibrating_run(demo->options->input ? demo->options->input
								  : demo->dance,
					     &board, &options, &demo->calibrating, error);
	if (status == DIO_OK && !file)
		status = dio_fail(error, DIO_NO_MEM, "no memory for a path");
	if (status == DIO_OK)
		status = dio_camera_model_write(file, DIO_CAMERA_FILE_OPENCV, &c->model, c, error);
	if (status == DIO_OK)
		finish(demo, "calibrate", seconds_since(start),
		       "%u of %u views used, %.3f px RMS, %.3f px held out", c->views_used,
		       c->views_total, c->rms_px, c->heldout_rms_px);
	free(file);
	return status;
}

static int remove_entry(const char *path, const struct stat *info, int kind, struct FTW *walk)
{
	(void)info;
	(void)kind;
	(void)walk;
	return remove(path);
}

/* An earlier run's recording makes room; a folder that is none is left to the recorder to refuse.
 */
static enum dio_status remove_recording(const char *folder, struct dio_error *error)
{
	char *index = dio_path_join(folder, "recording.json");
	enum dio_status status = DIO_OK;

	if (!index)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);
	else if (dio_path_is_file(index) &&
		 nftw(folder, remove_entry, 16, FTW_DEPTH | FTW_PHYS | FTW_MOUNT) != 0)
		status = dio_fail(error, DIO_IO, "%s: the earlier recording cannot be removed",
				  folder);
	free(index);
	return status;
}

static enum dio_status capture(struct dio_demo *demo, struct dio_error *error)
{
	struct dio_recording_options options = {
		.camera = {.frames_per_second = demo->options->frames / WALK_S},
		.frames = demo->options->frames,
	};
	uint64_t start = dio_clock_ns();
	char *folder = dio_demo_path(demo, "capture");
	enum dio_status status;

	if (!folder)
		return dio_fail(error, DIO_NO_MEM, "no memory for a path");
	status = remove_recording(folder, error);
	if (status == DIO_OK)
		status = dio_recording_run(demo->walk, folder, &options, &demo->recording, error);
	if (status == DIO_OK)
		finish(demo, "capture", seconds_since(start),
		       "%" PRIu64 " pictures of %u x %u round the scene", demo->recording.frames,
		       demo->recording.camera.width, demo->recording.camera.height);
	free(folder);
	return status;
}

static enum dio_status pose(struct dio_demo *demo, struct dio_error *error)
{
	struct dio_board board = dio_calibrating_get_board(&demo->calibrating);
	struct dio_posing *posing = &demo->posing;
	struct dio_posing_options options;
	uint64_t start = dio_clock_ns();
	char *capture_folder = dio_demo_path(demo, "capture");
	char *file = dio_demo_path(demo, "scene.json");
	enum dio_status status = DIO_OK;

	dio_posing_defaults(&options);
	options.width = demo->options->width;
	options.height = demo->options->height;
	options.context = demo->options->context;
	if (!capture_folder || !file)
		status = dio_fail(error, DIO_NO_MEM, "no memory for a path");
	if (status == DIO_OK)
		status = dio_posing_run(
			demo->options->input ? demo->options->input : capture_folder,
			&demo->calibrating.calibration.model, &board, &options, posing, error);
	if (status == DIO_OK)
		status = dio_posing_write(posing, "demo", file, error);
	if (status == DIO_OK)
		finish(demo, "poses", seconds_since(start),
		       "%u of %u pictures posed, %.3f px; %u context views, %u held back",
		       posing->posed, posing->count, posing->rms_px, posing->context,
		       posing->targets);
	free(file);
	free(capture_folder);
	return status;
}

/* From here on the scene is what the files say: the same as for any other scene.json. */
static enum dio_status load(struct dio_demo *demo, struct dio_error *error)
{
	struct dio_scene_file scene = {0};
	char *file = dio_demo_path(demo, "scene.json");
	enum dio_status status = file ? dio_scene_file_read(file, &scene, error)
				      : dio_fail(error, DIO_NO_MEM, "no memory for a path");

	if (status == DIO_OK)
		status = dio_view_set_load(&scene, DIO_LOAD_ALL, &demo->set, error);
	dio_scene_file_deinit(&scene);
	free(file);
	return status;
}

static enum dio_status reconstruct_and_render(struct dio_demo *demo, struct dio_error *error)
{
	struct dio_evaluation *eval = &demo->evaluation;
	char *file = dio_demo_path(demo, "scene.safetensors");
	enum dio_status status = load(demo, error);

	if (status == DIO_OK)
		status = dio_session_open(&demo->options->engine, &demo->session, error);
	if (status == DIO_OK)
		status = dio_evaluate(demo->session, &demo->set, eval, error);
	if (status == DIO_OK && !file)
		status = dio_fail(error, DIO_NO_MEM, "no memory for a path");
	if (status == DIO_OK)
		status = dio_session_save_scene(demo->session, file, error);
	free(file);
	if (status != DIO_OK)
		return status;
	finish(demo, "reconstruct", (double)eval->reconstruct.time_ns * 1e-9,
	       "%u views, %u tokens, %.1f MiB KV-cache", eval->reconstruct.views,
	       eval->reconstruct.tokens,
	       (double)eval->reconstruct.memory.cache_bytes / (1024.0 * 1024.0));
	finish(demo, "render", (double)eval->render_ns * eval->count * 1e-9,
	       "%u held-back viewpoints, %.1f ms each; %.2f dB PSNR, nearest view %.2f dB",
	       eval->count, (double)eval->render_ns * 1e-6, eval->psnr_db, eval->nearest_psnr_db);
	return DIO_OK;
}

static enum dio_status orbit(struct dio_demo *demo, struct dio_error *error)
{
	uint64_t start = dio_clock_ns();
	enum dio_status status = dio_demo_render_orbit(demo, error);

	if (status == DIO_OK)
		finish(demo, "orbit", seconds_since(start), "%u pictures, %.1f ms each to render",
		       demo->options->orbit_frames, (double)demo->orbit_render_ns * 1e-6);
	return status;
}

static enum dio_status run_stages(struct dio_demo *demo, char **json, struct dio_error *error)
{
	enum dio_status status = dio_folder_make(demo->options->out, error);

	if (status == DIO_OK)
		status = calibrate(demo, error);
	if (status == DIO_OK && !demo->options->input)
		status = capture(demo, error);
	if (status == DIO_OK)
		status = pose(demo, error);
	if (status == DIO_OK)
		status = reconstruct_and_render(demo, error);
	if (status == DIO_OK)
		status = orbit(demo, error);
	if (status == DIO_OK)
		status = dio_demo_write_sheet(demo, error);
	if (status == DIO_OK && !demo->options->input)
		status = dio_demo_compare(demo, error);
	if (status == DIO_OK)
		status = dio_demo_write_summary(demo, json, error);
	return status;
}

static void deinit(struct dio_demo *demo)
{
	for (uint32_t i = 0; i < demo->orbit_count; i++)
		dio_picture_deinit(&demo->orbit[i]);
	free(demo->orbit);
	dio_evaluation_deinit(&demo->evaluation);
	dio_session_close(demo->session);
	dio_view_set_deinit(&demo->set);
	dio_posing_deinit(&demo->posing);
	dio_calibrating_deinit(&demo->calibrating);
}

enum dio_status dio_demo_run(const struct dio_demo_options *options, char **json,
			     struct dio_error *error)
{
	struct dio_demo demo = {.options = options};
	enum dio_status status;

	snprintf(demo.dance, sizeof demo.dance, SIM_CAMERA, "dance", options->seed, SIM_WIDTH,
		 SIM_HEIGHT, options->board);
	snprintf(demo.walk, sizeof demo.walk, SIM_CAMERA, "walk", options->seed, SIM_WIDTH,
		 SIM_HEIGHT, options->board);
	status = run_stages(&demo, json, error);
	deinit(&demo);
	return status;
}
