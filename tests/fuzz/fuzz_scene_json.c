/*
 * scene.json of any bytes: read or refused with one line, never a crash. What is read obeys
 * MODEL.md section 7, and is the same after it was written and read again.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/scene_file.h"
#include "core/text.h"

/* libFuzzer's interface has no header in C. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(int truth, const char *what)
{
	if (!truth) {
		fprintf(stderr, "fuzz_scene_json: %s\n", what);
		abort();
	}
}

static void check_frame(const struct dio_scene_frame *frame)
{
	require(frame->file != NULL || frame->role == DIO_ROLE_TARGET, "a context without file");
	require(frame->camera.width >= 1 && frame->camera.width <= 16384, "a width out of range");
	require(frame->camera.height >= 1 && frame->camera.height <= 16384,
		"a height out of range");
	require(frame->camera.fx > 0 && frame->camera.fy > 0, "a focal length not above zero");
	require(isfinite(frame->camera.cx) && isfinite(frame->camera.cy), "cx or cy not finite");
	for (int i = 0; i < 16; i++)
		require(isfinite(frame->pose.world_from_camera[i]), "a pose that is not finite");
}

/* Through a file and back. */
static void check_round_trip(const struct dio_scene_file *scene)
{
	struct dio_scene_file back = {0};
	struct dio_error error = {""};
	char path[64], *text = NULL;
	size_t size;

	snprintf(path, sizeof path, "/tmp/fuzz_scene_json.%ld.json", (long)getpid());
	require(dio_scene_file_write(scene, path, &error) == DIO_OK, error.text);
	require(dio_text_read(path, DIO_SCENE_BYTES_MAX, &text, &size, &error) == DIO_OK,
		error.text);
	unlink(path);
	require(dio_scene_file_parse(text, size, path, &back, &error) == DIO_OK, error.text);
	free(text);
	require(back.frame_count == scene->frame_count, "another number of frames");
	for (uint32_t i = 0; i < back.frame_count; i++) {
		const struct dio_scene_frame *a = &scene->frames[i], *b = &back.frames[i];

		require(a->role == b->role && !a->file == !b->file, "another frame");
		require(!a->file || strcmp(a->file, b->file) == 0, "another file");
		for (int k = 0; k < 16; k++) /* not by bytes: -0 may come back as 0 */
			require(a->pose.world_from_camera[k] == b->pose.world_from_camera[k],
				"another pose");
	}
	dio_scene_file_deinit(&back);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	/* Of exact size: reading one byte past the end is a finding. */
	char *text = malloc(size ? size : 1);
	struct dio_scene_file scene = {0};
	struct dio_error error = {""};
	static unsigned accepted;

	require(text != NULL, "no memory");
	memcpy(text, data, size);
	if (dio_scene_file_parse(text, size, "input", &scene, &error) == DIO_OK) {
		require(dio_scene_file_count(&scene, DIO_ROLE_CONTEXT) > 0, "no context view");
		for (uint32_t i = 0; i < scene.frame_count; i++)
			check_frame(&scene.frames[i]);
		if (accepted++ % 64 == 0) /* the disk is slow beside the parser */
			check_round_trip(&scene);
	} else {
		require(scene.frames == NULL && scene.name == NULL, "an output was touched");
		require(strncmp(error.text, "input: ", 7) == 0,
			"a text that does not name the file");
		require(strpbrk(error.text, "\r\n") == NULL, "a text of more than one line");
	}
	dio_scene_file_deinit(&scene);
	free(text);
	return 0;
}
