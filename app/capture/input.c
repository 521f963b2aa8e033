#include "capture/input.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/log.h"

/* A camera that starts up may need a second or two for its first frame. */
#define FRAME_TIMEOUT_NS 3000000000

/* A camera whose every frame is damaged is not worth waiting for. */
#define DAMAGED_IN_A_ROW_MAX 100u

struct dio_input {
	struct dio_camera *camera;
	struct dio_camera_info info;
	char *spec;
	uint64_t index;
	uint32_t unreadable;
};

/* Does `spec` have the word that starts at `word` and ends with its '='? */
static bool has_word(const char *spec, const char *word)
{
	size_t length = strcspn(word, "=") + 1;

	for (const char *at = strchr(spec, '?'); at; at = strchr(at + 1, '&'))
		if (strncmp(at + 1, word, length) == 0)
			return true;
	return false;
}

char *dio_input_instruct(const char *spec, const char *words)
{
	size_t size = strlen(spec) + strlen(words) + 2;
	char *told = malloc(size);

	if (!told)
		return NULL;
	snprintf(told, size, "%s", spec);
	if (strncmp(spec, "sim:", 4) != 0)
		return told;
	for (const char *word = words; *word;) {
		size_t length = strcspn(word, "&"), used = strlen(told);

		if (!has_word(spec, word))
			snprintf(told + used, size - used, "%c%.*s", strchr(told, '?') ? '&' : '?',
				 (int)length, word);
		word += length + (word[length] == '&');
	}
	return told;
}

enum dio_status dio_input_open(const char *spec, const struct dio_camera_options *options,
			       struct dio_input **input, struct dio_error *error)
{
	struct dio_camera_options wishes = options ? *options : (struct dio_camera_options){0};
	struct dio_input *made = calloc(1, sizeof *made);
	enum dio_status status = DIO_NO_MEM;

	if (made)
		made->spec = strdup(spec);
	if (!made || !made->spec) {
		dio_fail(error, status, "%s: no memory", spec);
		goto fail;
	}
	wishes.as_fast_as_possible = true;
	wishes.every_frame = strncmp(spec, "v4l2:", 5) != 0 && strncmp(spec, "/dev/", 5) != 0;
	status = dio_camera_open(spec, &wishes, &made->camera, error);
	if (status == DIO_OK)
		status = dio_camera_start(made->camera, error);
	if (status != DIO_OK)
		goto fail;
	dio_camera_get_info(made->camera, &made->info);
	*input = made;
	return DIO_OK;
fail:
	dio_input_close(made);
	return status;
}

void dio_input_close(struct dio_input *input)
{
	if (!input)
		return;
	dio_camera_close(input->camera);
	free(input->spec);
	free(input);
}

enum dio_input_kind dio_input_get_kind(const struct dio_input *input)
{
	if (input->info.frame_count == 0)
		return DIO_INPUT_LIVE;
	return input->info.frames_per_second > 0 ? DIO_INPUT_RECORDING : DIO_INPUT_PHOTOS;
}

const struct dio_camera *dio_input_get_camera(const struct dio_input *input)
{
	return input->camera;
}

uint64_t dio_input_get_length(const struct dio_input *input)
{
	return input->info.frame_count;
}

uint32_t dio_input_get_unreadable(const struct dio_input *input)
{
	return input->unreadable;
}

static void describe(const struct dio_input *input, const struct dio_frame *frame,
		     struct dio_input_frame *about)
{
	const char *name = dio_camera_get_frame_name(input->camera);

	about->index = input->index;
	about->timestamp_ns = frame->timestamp_ns;
	if (*name)
		snprintf(about->name, sizeof about->name, "%s", name);
	else
		snprintf(about->name, sizeof about->name, "frame %" PRIu64, input->index);
}

enum dio_status dio_input_next_frame(struct dio_input *input, struct dio_frame *frame,
				     struct dio_input_frame *about, struct dio_error *error)
{
	struct dio_input_frame ignored;
	struct dio_error why = {""};
	enum dio_status status;

	for (uint32_t damaged = 0; damaged < DAMAGED_IN_A_ROW_MAX; damaged++) {
		status = dio_camera_acquire(input->camera, frame, FRAME_TIMEOUT_NS, &why);
		if (status == DIO_OK) {
			describe(input, frame, about ? about : &ignored);
			input->index++;
			return DIO_OK;
		}
		if (status == DIO_AGAIN || status == DIO_NO_SIGNAL)
			return dio_fail(error, DIO_NO_SIGNAL,
					"camera %s: no frame for %d s (%" PRIu64
					" frames before): is the cable in?",
					input->spec, (int)(FRAME_TIMEOUT_NS / 1000000000),
					input->index);
		if (status != DIO_BAD_FILE)
			return dio_fail(error, status, "%s",
					*why.text ? why.text : dio_status_text(status));
		dio_log_warn("%s; it is left out", why.text);
		input->unreadable++;
		input->index++;
	}
	return dio_fail(error, DIO_BAD_FILE, "%s: %u pictures in a row cannot be read", input->spec,
			DAMAGED_IN_A_ROW_MAX);
}

enum dio_status dio_input_next(struct dio_input *input, struct dio_picture *picture,
			       struct dio_input_frame *about, struct dio_error *error)
{
	struct dio_input_frame here;
	struct dio_error why = {""};
	struct dio_frame frame;

	for (uint32_t damaged = 0; damaged < DAMAGED_IN_A_ROW_MAX; damaged++) {
		enum dio_status status = dio_input_next_frame(input, &frame, &here, error);

		if (status != DIO_OK)
			return status;
		status = dio_frame_to_rgb(&frame, picture, &why);
		if (status == DIO_OK) {
			if (about)
				*about = here;
			return DIO_OK;
		}
		if (status != DIO_BAD_FILE && status != DIO_BAD_ARG)
			return dio_fail(error, status, "%s: %s", here.name, why.text);
		dio_log_warn("%s: %s; it is left out", here.name, why.text);
		input->unreadable++;
	}
	return dio_fail(error, DIO_BAD_FILE, "%s: %u frames in a row are damaged", input->spec,
			DAMAGED_IN_A_ROW_MAX);
}
