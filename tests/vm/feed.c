/* vm_feed DEVICE FILE MS FIRST COUNT [ROUNDS]: show frames of a file on a V4L2 output.
 *
 * FILE holds frames one after the other, each of the size that the device's format has. Each is on
 * show for MS milliseconds; vivid shows the buffer queued last until there is another one, so one
 * is queued whenever the one before it has come back. ROUNDS 0: until it is ended. */
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define BUFFERS 4u

struct output {
	int fd;
	size_t frame_bytes;
	void *memory[BUFFERS];
	unsigned shown; /* frames queued so far */
};

static bool complain(const char *what)
{
	fprintf(stderr, "vm_feed: %s: %s\n", what, strerror(errno));
	return false;
}

static bool open_output(const char *path, struct output *output)
{
	struct v4l2_format format = {.type = V4L2_BUF_TYPE_VIDEO_OUTPUT};
	struct v4l2_requestbuffers wanted = {
		.count = BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};

	output->fd = open(path, O_RDWR | O_CLOEXEC);
	if (output->fd < 0 || ioctl(output->fd, VIDIOC_G_FMT, &format) != 0 ||
	    ioctl(output->fd, VIDIOC_REQBUFS, &wanted) != 0 || wanted.count != BUFFERS)
		return complain(path);
	output->frame_bytes = format.fmt.pix.sizeimage;
	for (unsigned i = 0; i < BUFFERS; i++) {
		struct v4l2_buffer buffer = {
			.index = i, .type = wanted.type, .memory = wanted.memory};

		if (ioctl(output->fd, VIDIOC_QUERYBUF, &buffer) != 0)
			return complain("VIDIOC_QUERYBUF");
		output->memory[i] = mmap(NULL, buffer.length, PROT_READ | PROT_WRITE, MAP_SHARED,
					 output->fd, buffer.m.offset);
		if (output->memory[i] == MAP_FAILED)
			return complain("mmap");
	}
	return true;
}

/* Queue a frame; on return the one before it is off the screen. */
static bool show(struct output *output, const unsigned char *frame)
{
	const unsigned index = output->shown % BUFFERS;
	struct v4l2_buffer buffer = {.index = index,
				     .type = V4L2_BUF_TYPE_VIDEO_OUTPUT,
				     .memory = V4L2_MEMORY_MMAP,
				     .bytesused = (unsigned)output->frame_bytes,
				     .field = V4L2_FIELD_NONE};
	int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;

	memcpy(output->memory[index], frame, output->frame_bytes);
	if (ioctl(output->fd, VIDIOC_QBUF, &buffer) != 0)
		return complain("VIDIOC_QBUF");
	if (output->shown++ == 0)
		return ioctl(output->fd, VIDIOC_STREAMON, &type) == 0 || complain("STREAMON");
	buffer = (struct v4l2_buffer){.type = V4L2_BUF_TYPE_VIDEO_OUTPUT,
				      .memory = V4L2_MEMORY_MMAP};
	return ioctl(output->fd, VIDIOC_DQBUF, &buffer) == 0 || complain("VIDIOC_DQBUF");
}

static unsigned char *read_frames(const char *path, size_t first, size_t count, size_t frame_bytes)
{
	unsigned char *frames = malloc(count * frame_bytes);
	FILE *file = fopen(path, "rb");
	bool read = file && frames && fseek(file, (long)(first * frame_bytes), SEEK_SET) == 0 &&
		    fread(frames, frame_bytes, count, file) == count;

	if (file)
		fclose(file);
	if (read)
		return frames;
	fprintf(stderr, "vm_feed: %s: frames %zu to %zu of %zu bytes are not there\n", path, first,
		first + count - 1, frame_bytes);
	free(frames);
	return NULL;
}

int main(int argc, char **argv)
{
	struct output output = {.fd = -1};
	struct timespec pause;
	unsigned char *frames;
	size_t count;
	long ms, rounds;

	if (argc < 6) {
		fprintf(stderr, "usage: vm_feed DEVICE FILE MS FIRST COUNT [ROUNDS]\n");
		return 2;
	}
	ms = strtol(argv[3], NULL, 10);
	count = (size_t)strtoul(argv[5], NULL, 10);
	rounds = argc > 6 ? strtol(argv[6], NULL, 10) : 1;
	pause = (struct timespec){ms / 1000, ms % 1000 * 1000000};
	if (!open_output(argv[1], &output))
		return 1;
	frames =
		read_frames(argv[2], (size_t)strtoul(argv[4], NULL, 10), count, output.frame_bytes);
	if (!frames)
		return 1;
	for (long round = 0; rounds == 0 || round < rounds; round++)
		for (size_t i = 0; i < count; i++) {
			if (!show(&output, frames + i * output.frame_bytes))
				return 1;
			nanosleep(&pause, NULL);
		}
	free(frames);
	close(output.fd);
	return 0;
}
