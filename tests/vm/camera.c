/* vm_camera SPEC: open a camera for each line of standard input and take frames of it.
 *
 * A line is "WIDTH HEIGHT FPS FRAMES [FOURCC]", with a FOURCC as a number: the format that the
 * device is left in before, as by another program. Prints "ok WIDTHxHEIGHT FORMAT frames N" for
 * each, or "status N: why" where opening, starting or taking fails: a status is an answer, whatever
 * it says; a crash is none. */
#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "dio/camera.h"

#define PATIENCE_NS INT64_C(10000000000)

static int leave_in_format(const char *path, unsigned fourcc)
{
	struct v4l2_format format = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
	int fd = open(path, O_RDWR | O_CLOEXEC);
	int result = -1;

	if (fd >= 0 && ioctl(fd, VIDIOC_G_FMT, &format) == 0) {
		format.fmt.pix.pixelformat = fourcc;
		if (ioctl(fd, VIDIOC_S_FMT, &format) == 0 && format.fmt.pix.pixelformat == fourcc)
			result = 0;
	}
	if (fd >= 0)
		close(fd);
	return result;
}

static void take(const char *spec, const struct dio_camera_options *options, unsigned frames)
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
	fflush(stdout);
	dio_picture_deinit(&picture);
	dio_camera_close(camera);
}

int main(int argc, char **argv)
{
	struct dio_camera_options options = {0};
	unsigned frames, fourcc;
	char line[128];

	if (argc != 2 || strncmp(argv[1], "v4l2:", 5) != 0) {
		fprintf(stderr, "usage: vm_camera v4l2:DEVICE < LINES\n");
		return 2;
	}
	while (fgets(line, sizeof line, stdin)) {
		int read = sscanf(line, "%u %u %lf %u %u", &options.width, &options.height,
				  &options.frames_per_second, &frames, &fourcc);

		if (read < 4 || (read == 5 && leave_in_format(argv[1] + 5, fourcc) != 0)) {
			fprintf(stderr, "vm_camera: cannot be done: %s", line);
			return 1;
		}
		take(argv[1], &options, frames);
	}
	return 0;
}
