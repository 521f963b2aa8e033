/* render: viewpoints of a scene as pictures, a film, or raw numbers. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "core/json_out.h"
#include "core/npy.h"
#include "core/options.h"
#include "core/path.h"
#include "core/progress.h"
#include "dio/video.h"
#include "engine_options.h"
#include "report.h"
#include "shots.h"

#define DEFAULT_FRAMES 120

struct render_job {
	struct dio_session_options session;
	struct shots_wish shots;
	const char *scene, *scene_cache, *out;
	bool raw, json, hash;
};

/* Where rendered pictures go. Each that is open gets every picture. */
struct sinks {
	struct dio_npy *npy;
	struct dio_video *video;
	const char *folder; /* for one PNG a picture; NULL when a film is made */
	float *rgb;         /* of the largest picture; NULL without --raw */
	struct dio_picture pictures[DIO_BATCH_MAX]; /* those at hand */
	uint64_t render_ns;
	cJSON *hashes; /* of each picture's bytes; NULL without --hash */
};

/* The film is called after its path: orbit.mp4, or the trajectory's name. */
static char *film_path(const struct render_job *job, const struct shots *shots)
{
	const char *dot = strrchr(shots->name, '.');
	int length = (int)(dot && dot != shots->name ? (size_t)(dot - shots->name)
						     : strlen(shots->name));
	char *name, *path;

	if (asprintf(&name, "%.*s.mp4", length, shots->name) < 0)
		return NULL;
	path = dio_path_join(job->out, name);
	free(name);
	return path;
}

static enum dio_status open_npy(const struct render_job *job, const struct shots *shots,
				struct sinks *sinks, struct dio_error *error)
{
	const struct dio_camera_model *first = &shots->list[0].camera;
	enum dio_status status;
	char *path;

	for (uint32_t i = 1; i < shots->count; i++)
		if (shots->list[i].camera.width != first->width ||
		    shots->list[i].camera.height != first->height)
			return dio_fail(error, DIO_BAD_ARG,
					"--raw: frames.npy needs one size: %s is %ux%u, %s is "
					"%ux%u",
					shots->list[0].name, first->width, first->height,
					shots->list[i].name, shots->list[i].camera.width,
					shots->list[i].camera.height);
	path = dio_path_join(job->out, "frames.npy");
	if (!path)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", job->out);
	status = dio_npy_open(path, shots->count, first->height, first->width, &sinks->npy, error);
	free(path);
	sinks->rgb = malloc((size_t)3 * first->width * first->height * sizeof *sinks->rgb);
	if (status == DIO_OK && !sinks->rgb)
		status = dio_fail(error, DIO_NO_MEM, "no memory for a picture");
	return status;
}

static enum dio_status open_sinks(const struct render_job *job, const struct shots *shots,
				  struct sinks *sinks, struct dio_error *error)
{
	const struct dio_camera_model *first = &shots->list[0].camera;
	enum dio_status status = DIO_OK;
	char *path;

	if (job->raw)
		status = open_npy(job, shots, sinks, error);
	if (status != DIO_OK || !shots->is_path) {
		sinks->folder = job->out;
		return status;
	}
	path = film_path(job, shots);
	if (!path)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", job->out);
	status = dio_video_open(path, first->width, first->height, job->shots.frames_per_second,
				&sinks->video, error);
	free(path);
	return status;
}

/* After a failure the files keep what they held before; the first failure is the one told. */
static enum dio_status close_sinks(struct sinks *sinks, enum dio_status status,
				   struct dio_error *error)
{
	struct dio_error later = {0};
	enum dio_status npy = dio_npy_close(sinks->npy, &later);

	if (status == DIO_OK && npy != DIO_OK) {
		status = npy;
		*error = later;
	}
	if (status == DIO_OK)
		status = dio_video_close(sinks->video, error);
	else
		dio_video_discard(sinks->video);
	for (uint32_t i = 0; i < DIO_BATCH_MAX; i++)
		dio_picture_deinit(&sinks->pictures[i]);
	free(sinks->rgb);
	return status;
}

static enum dio_status write_png(const struct sinks *sinks, const char *name,
				 const struct dio_picture *picture, struct dio_error *error)
{
	enum dio_status status;
	char *file, *path;

	if (asprintf(&file, "%s.png", name) < 0)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", name);
	path = dio_path_join(sinks->folder, file);
	free(file);
	if (!path)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", name);
	status = dio_picture_write(path, picture, error);
	free(path);
	return status;
}

static enum dio_status fit_picture(struct dio_picture *picture,
				   const struct dio_camera_model *camera, struct dio_error *error)
{
	enum dio_status status;

	if (picture->width == camera->width && picture->height == camera->height)
		return DIO_OK;
	dio_picture_deinit(picture);
	status = dio_picture_init(picture, camera->width, camera->height);
	return status == DIO_OK ? DIO_OK : dio_fail(error, status, "no memory for a picture");
}

static void add_hash(cJSON *hashes, const char *name, const struct dio_picture *picture)
{
	cJSON *item = cJSON_CreateObject();
	char hex[65];

	dvsm_hash_bytes(picture->rgb, (size_t)picture->width * picture->height * 3, hex);
	dio_json_add_text(item, "name", name);
	dio_json_add_text(item, "sha256", hex);
	cJSON_AddItemToArray(hashes, item);
}

static enum dio_status put_picture(struct sinks *sinks, const char *name,
				   const struct dio_picture *picture, struct dio_error *error)
{
	if (sinks->hashes)
		add_hash(sinks->hashes, name, picture);
	if (sinks->video)
		return dio_video_append(sinks->video, picture, error);
	return write_png(sinks, name, picture, error);
}

/* With its numbers, for --raw. */
static enum dio_status render_raw(struct dio_session *session, const struct shot *shot,
				  struct sinks *sinks, struct dio_error *error)
{
	struct dio_picture *picture = &sinks->pictures[0];
	struct dvsm_stats stats = {0};
	enum dio_status status =
		dio_session_render(session, &shot->camera, &shot->pose, sinks->rgb, &stats, error);

	if (status == DIO_OK)
		status = fit_picture(picture, &shot->camera, error);
	if (status != DIO_OK)
		return status;
	sinks->render_ns += stats.time_ns;
	dio_picture_from_float(sinks->rgb, picture);
	if ((status = dio_npy_append(sinks->npy, sinks->rgb, error)) != DIO_OK)
		return status;
	return put_picture(sinks, shot->name, picture, error);
}

/* As many of the shots as are best rendered at once; *count says how many of them were. */
static enum dio_status render_some(struct dio_session *session, const struct shot *shots,
				   uint32_t *count, struct sinks *sinks, struct dio_error *error)
{
	const struct dio_camera_model *cameras[DIO_BATCH_MAX];
	const struct dio_pose *poses[DIO_BATCH_MAX];
	const uint32_t best = dio_session_batch_size(session, &shots[0].camera);
	struct dvsm_stats stats = {0};
	enum dio_status status;
	uint32_t some = 0;

	for (; some < best && some < *count; some++) {
		if (shots[some].camera.width != shots[0].camera.width ||
		    shots[some].camera.height != shots[0].camera.height)
			break;
		cameras[some] = &shots[some].camera;
		poses[some] = &shots[some].pose;
	}
	status = dio_session_render_batch(session, cameras, poses, some, sinks->pictures, &stats,
					  error);
	if (status == DIO_BAD_ARG && some > 1) {
		/* One by one, those in front of the faulty one are rendered. */
		some = 1;
		status = dio_session_render_batch(session, cameras, poses, some, sinks->pictures,
						  &stats, error);
	}
	*count = some;
	sinks->render_ns += stats.time_ns;
	for (uint32_t i = 0; status == DIO_OK && i < some; i++)
		status = put_picture(sinks, shots[i].name, &sinks->pictures[i], error);
	return status;
}

static enum dio_status render_all(const struct render_job *job, struct dio_session *session,
				  const struct shots *shots, cJSON *hashes, uint64_t *render_ns,
				  struct dio_error *error)
{
	struct sinks sinks = {.hashes = hashes};
	struct dio_progress progress;
	enum dio_status status;

	if (shots->count == 0)
		return dio_fail(error, DIO_BAD_ARG, "%s: no viewpoint to render", shots->name);
	status = open_sinks(job, shots, &sinks, error);

	dio_progress_init(&progress, "rendering");
	for (uint32_t i = 0, count; status == DIO_OK && i < shots->count; i += count) {
		dio_progress_update(&progress, (double)i / shots->count);
		count = job->raw ? 1 : shots->count - i;
		status = job->raw ? render_raw(session, &shots->list[i], &sinks, error)
				  : render_some(session, &shots->list[i], &count, &sinks, error);
	}
	dio_progress_done(&progress);
	*render_ns = sinks.render_ns / shots->count;
	return close_sinks(&sinks, status, error);
}

/* A scene from its cache when there is one, else made from its pictures. */
static enum dio_status open_scene(const struct render_job *job, struct dio_session **session,
				  struct dio_view_set *set, struct dio_error *error)
{
	enum dio_view_load load = job->scene_cache ? 0 : DIO_LOAD_CONTEXT;
	struct dio_scene_file file = {0};
	enum dio_status status = DIO_OK;

	if (job->scene) {
		status = dio_scene_file_read(job->scene, &file, error);
		if (status == DIO_OK)
			status = dio_view_set_load(&file, load, set, error);
		dio_scene_file_deinit(&file);
	}
	if (status == DIO_OK)
		status = dio_session_open(&job->session, session, error);
	if (status != DIO_OK)
		return status;
	dio_report_engine(*session);
	if (job->scene_cache)
		return dio_session_open_scene(*session, job->scene_cache, error);
	return dio_session_reconstruct(*session, set->context, set->context_count, NULL, error);
}

/* What --hash tells. */
struct hashes {
	char cache[65];
	cJSON *frames; /* NULL without it */
};

static void print_hashes(const struct hashes *hashes)
{
	const cJSON *frame;

	if (!hashes->frames)
		return;
	printf("%s  cache\n", hashes->cache);
	cJSON_ArrayForEach(frame, hashes->frames)
		printf("%s  %s\n", cJSON_GetObjectItem(frame, "sha256")->valuestring,
		       cJSON_GetObjectItem(frame, "name")->valuestring);
}

static enum dio_status print_result(const struct render_job *job, const struct dio_session *session,
				    const struct shots *shots, const struct hashes *hashes,
				    uint64_t render_ns, struct dio_error *error)
{
	const struct dio_camera_model *camera = &shots->list[0].camera;
	double render_ms = (double)render_ns * 1e-6;
	uint32_t patch_px = dio_session_get_patch_render(session, camera);
	cJSON *root;

	if (!job->json) {
		printf("%s: %u pictures of %ux%u, %.1f ms each (patch %u)\n", job->out,
		       shots->count, camera->width, camera->height, render_ms, patch_px);
		print_hashes(hashes);
		return DIO_OK;
	}
	root = cJSON_CreateObject();
	dio_json_add_text(root, "out", job->out);
	cJSON_AddNumberToObject(root, "pictures", shots->count);
	cJSON_AddNumberToObject(root, "width", camera->width);
	cJSON_AddNumberToObject(root, "height", camera->height);
	cJSON_AddNumberToObject(root, "patch_render", patch_px);
	dio_json_add_number(root, "render_ms", render_ms, 3);
	if (hashes->frames) {
		dio_json_add_text(root, "cache_sha256", hashes->cache);
		cJSON_AddItemReferenceToObject(root, "frames", hashes->frames);
	}
	return dio_json_print(root, error);
}

static enum dio_status render(const struct render_job *job, struct dio_error *error)
{
	struct dio_view_set set = {0};
	struct dio_session *session = NULL;
	struct shots shots = {0};
	struct hashes hashes = {.frames = job->hash ? cJSON_CreateArray() : NULL};
	uint64_t render_ns = 0;
	enum dio_status status;

	/* First of all, so that nobody waits for pictures that have nowhere to go. */
	if ((status = dio_folder_make(job->out, error)) != DIO_OK)
		return status;
	if ((status = open_scene(job, &session, &set, error)) == DIO_OK &&
	    (status = shots_make(&job->shots, dio_session_get_scene(session),
				 job->scene ? &set : NULL, &shots, error)) == DIO_OK &&
	    (status = render_all(job, session, &shots, hashes.frames, &render_ns, error)) ==
		    DIO_OK) {
		if (job->hash)
			dvsm_scene_hash_cache(dio_session_get_scene(session), hashes.cache);
		status = print_result(job, session, &shots, &hashes, render_ns, error);
	}
	cJSON_Delete(hashes.frames);
	shots_deinit(&shots);
	dio_session_close(session);
	dio_view_set_deinit(&set);
	return status;
}

int dio_command_render(int argc, char **argv)
{
	struct render_job job = {.shots = {.frames = DEFAULT_FRAMES, .frames_per_second = 30}};
	const struct dio_option options[] = {
		DIO_OPTION_MODEL(job.session),
		{"scene", DIO_OPTION_TEXT, "FILE",
		 "scene.json: reconstructed, and gives the targets", &job.scene, 0, 0, false},
		{"scene-cache", DIO_OPTION_TEXT, "FILE",
		 "a scene that reconstruct wrote; nothing is reconstructed", &job.scene_cache, 0, 0,
		 false},
		{"path", DIO_OPTION_TEXT, "PATH",
		 "targets, orbit, or a trajectory in TUM format (default:\n"
		 "targets when the scene has any, else orbit)",
		 &job.shots.path, 0, 0, false},
		{"out", DIO_OPTION_TEXT, "DIR",
		 "folder for the pictures: NAME.png after each target, or an\n"
		 "MP4 film of a path",
		 &job.out, 0, 0, true},
		{"raw", DIO_OPTION_FLAG, NULL,
		 "also frames.npy: float32 [n, height, width, 3], not clamped:\n"
		 "the model's own numbers, for which --deblock auto means off",
		 &job.raw, 0, 0, false},
		{"frames", DIO_OPTION_COUNT, "N", "pictures of an orbit (default: 120)",
		 &job.shots.frames, 1, 100000, false},
		{"fps", DIO_OPTION_REAL, "F", "pictures a second of a film (default: 30)",
		 &job.shots.frames_per_second, 1, 240, false},
		DIO_OPTION_PATCH_RECON(job.session),
		DIO_OPTION_PATCH_RENDER(job.session),
		DIO_OPTION_THREADS(job.session),
		DIO_OPTION_CPU(job.session),
		DIO_OPTION_PRECISION(job.session),
		DIO_OPTION_DEBLOCKING(job.session),
		{"hash", DIO_OPTION_FLAG, NULL,
		 "print the SHA-256 of the scene's cache and of each picture's bytes", &job.hash, 0,
		 0, false},
		{"json", DIO_OPTION_FLAG, NULL, "results as JSON", &job.json, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "render",
		.summary = "render viewpoints of a scene",
		.arguments = "",
		.details =
			"A scene comes from --scene-cache, or from --scene, which is reconstructed "
			"first. With both,\nthe cache is rendered at the targets of "
			"scene.json.\n\n" DIO_HELP_PATCH,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	char **arguments;
	uint32_t count;
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	if (!job.scene && !job.scene_cache) {
		dio_fail(&error, DIO_BAD_ARG,
			 "--scene or --scene-cache is missing; see diorama "
			 "render --help");
		dio_report_failure(usage.command, &error);
		return DIO_EXIT_USAGE;
	}
	if (job.raw && job.session.deblock == DIO_DEBLOCK_AUTO)
		job.session.deblock = DIO_DEBLOCK_OFF;
	if (render(&job, &error) != DIO_OK)
		return dio_report_failure(usage.command, &error);
	return DIO_EXIT_OK;
}
