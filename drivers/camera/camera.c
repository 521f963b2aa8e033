#include "dio/camera.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "backend.h"

static bool begins_with(const char *text, const char *beginning)
{
	return strncmp(text, beginning, strlen(beginning)) == 0;
}

static enum dio_status check_options(const struct dio_camera_options *options,
				     struct dio_error *error)
{
	if (options->width > 16384 || options->height > 16384)
		return dio_fail(error, DIO_BAD_ARG,
				"camera: a size of %ux%u is wished; sides are at most 16384",
				options->width, options->height);
	if (!isfinite(options->frames_per_second) || options->frames_per_second < 0 ||
	    options->frames_per_second > 1000)
		return dio_fail(error, DIO_BAD_ARG,
				"camera: %g frames a second are wished; 0 to 1000 can be",
				options->frames_per_second);
	return DIO_OK;
}

static enum dio_status open_libcamera(const char *id, const struct dio_camera_options *options,
				      struct dio_camera **camera, struct dio_error *error)
{
#ifdef DIO_HAVE_LIBCAMERA
	return dio_libcamera_open(id, options, camera, error);
#else
	(void)options;
	(void)camera;
	return dio_fail(error, DIO_UNSUPPORTED,
			"camera libcamera:%s: this build has no libcamera; install libcamera-dev "
			"and build again",
			id);
#endif
}

enum dio_status dio_camera_open(const char *spec, const struct dio_camera_options *options,
				struct dio_camera **camera, struct dio_error *error)
{
	const struct dio_camera_options none = {0};
	enum dio_status status;
	struct stat st;

	if (!options)
		options = &none;
	if (!spec || !spec[0])
		return dio_fail(
			error, DIO_BAD_ARG,
			"camera: empty; say v4l2:/dev/video0, sim:table?seed=1 or a folder");
	status = check_options(options, error);
	if (status != DIO_OK)
		return status;
	if (begins_with(spec, "v4l2:"))
		return dio_v4l2_open(spec + 5, options, camera, error);
	if (begins_with(spec, "sim:"))
		return dio_sim_open(spec + 4, options, camera, error);
	if (begins_with(spec, "libcamera:"))
		return open_libcamera(spec + 10, options, camera, error);
	if (begins_with(spec, "replay:"))
		return dio_replay_open(spec + 7, options, camera, error);
	if (begins_with(spec, "/dev/"))
		return dio_v4l2_open(spec, options, camera, error);
	if (stat(spec, &st) != 0)
		return dio_fail(error, dio_status_from_errno(errno),
				"camera %s: %s; say v4l2:/dev/video0, sim:table?seed=1 or a folder",
				spec, strerror(errno));
	return dio_replay_open(spec, options, camera, error);
}

void dio_camera_close(struct dio_camera *camera)
{
	if (!camera)
		return;
	if (camera->started)
		camera->ops->stop(camera, NULL);
	camera->ops->close(camera);
}

enum dio_status dio_camera_start(struct dio_camera *camera, struct dio_error *error)
{
	enum dio_status status;

	if (camera->started)
		return DIO_OK;
	status = camera->ops->start(camera, error);
	camera->started = status == DIO_OK;
	return status;
}

enum dio_status dio_camera_stop(struct dio_camera *camera, struct dio_error *error)
{
	if (!camera->started)
		return DIO_OK;
	camera->started = false;
	return camera->ops->stop(camera, error);
}

enum dio_status dio_camera_acquire(struct dio_camera *camera, struct dio_frame *frame,
				   int64_t timeout_ns, struct dio_error *error)
{
	enum dio_status status;

	if (!camera->started)
		return dio_fail(error, DIO_BAD_ARG, "camera %s: not started", camera->info.name);
	status = camera->ops->acquire(camera, frame, timeout_ns < 0 ? 0 : timeout_ns, error);
	if (status == DIO_OK)
		camera->counters.delivered++;
	return status;
}

const char *dio_camera_get_frame_name(const struct dio_camera *camera)
{
	return camera->frame_name;
}

int dio_camera_get_dmabuf(struct dio_camera *camera)
{
	return camera->ops->dmabuf ? camera->ops->dmabuf(camera) : -1;
}

void dio_camera_get_info(const struct dio_camera *camera, struct dio_camera_info *info)
{
	*info = camera->info;
}

void dio_camera_get_counters(const struct dio_camera *camera, struct dio_camera_counters *counters)
{
	*counters = camera->counters;
}

static enum dio_status control(struct dio_camera *camera, const struct dio_camera_wish *wish,
			       struct dio_camera_controls *controls, struct dio_error *error)
{
	struct dio_camera_controls answer = {0};
	enum dio_status status;

	if (!camera->ops->control)
		return dio_fail(error, DIO_UNSUPPORTED, "camera %s: has no controls",
				camera->info.name);
	status = camera->ops->control(camera, wish, &answer, error);
	if (status == DIO_OK)
		*controls = answer;
	return status;
}

enum dio_status dio_camera_set_controls(struct dio_camera *camera,
					const struct dio_camera_wish *wish,
					struct dio_camera_controls *done, struct dio_error *error)
{
	if (!isfinite(wish->gain) || wish->gain < 0)
		return dio_fail(error, DIO_BAD_ARG, "camera %s: a gain of %g is wished",
				camera->info.name, wish->gain);
	return control(camera, wish, done, error);
}

enum dio_status dio_camera_get_controls(struct dio_camera *camera, struct dio_camera_controls *now,
					struct dio_error *error)
{
	return control(camera, NULL, now, error);
}
