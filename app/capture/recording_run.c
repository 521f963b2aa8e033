#include "capture/recording_run.h"

#include <inttypes.h>
#include <stdbool.h>

#include "capture/input.h"
#include "core/progress.h"
#include "dio/recording.h"

static bool is_stopped(const struct dio_recording_options *options)
{
	return options->stop && *options->stop;
}

static double share_done(const struct dio_input *input, const struct dio_recording_options *options,
			 const struct dio_recording_result *result)
{
	uint64_t length = dio_input_get_length(input);

	if (options->frames > 0)
		return (double)result->frames / (double)options->frames;
	if (options->seconds > 0)
		return result->seconds / options->seconds;
	return length > 0 ? (double)result->frames / (double)length : 0;
}

static enum dio_status record_all(struct dio_input *input, struct dio_recorder *recorder,
				  const struct dio_recording_options *options,
				  struct dio_recording_result *result, struct dio_error *error)
{
	struct dio_progress progress;
	struct dio_frame frame;
	uint64_t start_ns = 0;
	enum dio_status status = DIO_OK;

	dio_progress_init(&progress, "recording");
	while (!is_stopped(options)) {
		status = dio_input_next_frame(input, &frame, NULL, error);
		if (status != DIO_OK)
			break;
		if (result->frames == 0)
			start_ns = frame.timestamp_ns;
		result->seconds = (double)(frame.timestamp_ns - start_ns) * 1e-9;
		if (options->seconds > 0 && result->seconds > options->seconds)
			break;
		status = dio_recorder_append(recorder, &frame, error);
		if (status != DIO_OK)
			break;
		result->frames++;
		dio_progress_update(&progress, share_done(input, options, result));
		if (options->frames > 0 && result->frames >= options->frames)
			break;
	}
	dio_progress_done(&progress);
	/* A signal also wakes a camera that waits: that is the wish to stop, not a fault. */
	return status == DIO_END || is_stopped(options) ? DIO_OK : status;
}

enum dio_status dio_recording_run(const char *camera, const char *folder,
				  const struct dio_recording_options *options,
				  struct dio_recording_result *result, struct dio_error *error)
{
	struct dio_recorder *recorder = NULL;
	struct dio_input *input;
	struct dio_error why = {""}, why_close = {""};
	enum dio_status status = dio_input_open(camera, &options->camera, &input, error);
	enum dio_status closed;

	if (status != DIO_OK)
		return status;
	*result = (struct dio_recording_result){0};
	dio_camera_get_info(dio_input_get_camera(input), &result->camera);
	status = dio_recorder_open(folder, &result->camera, &recorder, error);
	if (status != DIO_OK)
		goto out;
	status = record_all(input, recorder, options, result, &why);
	closed = dio_recorder_close(recorder, &why_close);
	if (status == DIO_OK && closed != DIO_OK) {
		status = closed;
		why = why_close;
	}
	dio_camera_get_counters(dio_input_get_camera(input), &result->counters);
	result->unreadable = dio_input_get_unreadable(input);
	if (status != DIO_OK)
		dio_fail(error, status, "%s; %" PRIu64 " frames are kept in %s", why.text,
			 result->frames, folder);
out:
	dio_input_close(input);
	return status;
}
