/* vm_frames SPEC COUNT: pictures of a simulated camera on standard output, as fast as they come,
 * as YUYV: BT.601, limited range, one colour for two pixels. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "dio/camera.h"

#define PATIENCE_NS INT64_C(60000000000)

static uint8_t mix(const uint8_t *rgb, double red, double green, double blue, double base)
{
	return (uint8_t)(base + (red * rgb[0] + green * rgb[1] + blue * rgb[2]) / 255 + 0.5);
}

/* Two pixels: Y0 U Y1 V. */
static void convert_pair(const uint8_t *rgb, uint8_t *yuyv)
{
	uint8_t mean[3];

	for (int c = 0; c < 3; c++)
		mean[c] = (uint8_t)((rgb[c] + rgb[3 + c] + 1) / 2);
	yuyv[0] = mix(rgb, 65.481, 128.553, 24.966, 16);
	yuyv[1] = mix(mean, -37.797, -74.203, 112.0, 128);
	yuyv[2] = mix(rgb + 3, 65.481, 128.553, 24.966, 16);
	yuyv[3] = mix(mean, 112.0, -93.786, -18.214, 128);
}

static enum dio_status write_picture(const struct dio_picture *picture, struct dio_error *error)
{
	uint8_t yuyv[4];

	for (size_t i = 0; i + 1 < (size_t)picture->width * picture->height; i += 2) {
		convert_pair(picture->rgb + 3 * i, yuyv);
		if (fwrite(yuyv, sizeof yuyv, 1, stdout) != 1)
			return dio_fail(error, DIO_IO, "standard output: cannot be written");
	}
	return DIO_OK;
}

int main(int argc, char **argv)
{
	const struct dio_camera_options options = {.as_fast_as_possible = true,
						   .every_frame = true};
	struct dio_picture picture = {0};
	struct dio_camera *camera = NULL;
	struct dio_error error = {""};
	struct dio_frame frame;
	enum dio_status status;

	if (argc != 3) {
		fprintf(stderr, "usage: vm_frames SPEC COUNT\n");
		return 2;
	}
	status = dio_camera_open(argv[1], &options, &camera, &error);
	if (status == DIO_OK)
		status = dio_camera_start(camera, &error);
	for (unsigned long i = strtoul(argv[2], NULL, 10); status == DIO_OK && i > 0; i--) {
		status = dio_camera_acquire(camera, &frame, PATIENCE_NS, &error);
		if (status == DIO_OK)
			status = dio_frame_to_rgb(&frame, &picture, &error);
		if (status == DIO_OK)
			status = write_picture(&picture, &error);
	}
	if (status == DIO_OK && fflush(stdout) != 0)
		status = dio_fail(&error, DIO_IO, "standard output: cannot be written");
	if (status != DIO_OK)
		fprintf(stderr, "vm_frames: %s\n", error.text);
	dio_picture_deinit(&picture);
	dio_camera_close(camera);
	return status == DIO_OK ? 0 : 1;
}
