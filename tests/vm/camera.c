/* vm_camera SPEC WIDTH HEIGHT FPS FRAMES ROUNDS: open a camera so often and take frames of it.
 *
 * Prints "ok WIDTHxHEIGHT FORMAT frames N" a round, or "status N: why" where opening, starting or
 * taking fails: a status is an answer, whatever it says; a crash is none. */
#include <stdio.h>
#include <stdlib.h>

#include "dio/camera.h"

#define PATIENCE_NS INT64_C(3000000000)

static void take_round(const char *spec, const struct dio_camera_options *options, unsigned frames)
{
	struct dio_camera *camera = NULL;
	struct dio_picture picture = {0};
	struct dio_camera_info info = {0};
	struct dio_error error = {""};
	struct dio_frame frame;
	unsigned taken = 0;
	enum dio_status status = dio_camera_open(spec, options, &camera, &error);

	if (status == DIO_OK)
		status = dio_camera_start(camera, &error);
	while (status == DIO_OK && taken < frames) {
		status = dio_camera_acquire(camera, &frame, PATIENCE_NS, &error);
		if (status == DIO_OK)
			status = dio_frame_to_rgb(&frame, &picture, &error);
		taken += status == DIO_OK;
	}
	if (camera)
		dio_camera_get_info(camera, &info);
	if (status == DIO_OK)
		printf("ok %ux%u %s frames %u\n", info.width, info.height,
		       dio_pixel_format_name(info.format), taken);
	else
		printf("status %d: %s\n", (int)status, error.text);
	dio_picture_deinit(&picture);
	dio_camera_close(camera);
}

int main(int argc, char **argv)
{
	struct dio_camera_options options = {0};

	if (argc != 7) {
		fprintf(stderr, "usage: vm_camera SPEC WIDTH HEIGHT FPS FRAMES ROUNDS\n");
		return 2;
	}
	options.width = (uint32_t)strtoul(argv[2], NULL, 10);
	options.height = (uint32_t)strtoul(argv[3], NULL, 10);
	options.frames_per_second = strtod(argv[4], NULL);
	for (unsigned long round = strtoul(argv[6], NULL, 10); round > 0; round--)
		take_round(argv[1], &options, (unsigned)strtoul(argv[5], NULL, 10));
	return 0;
}
