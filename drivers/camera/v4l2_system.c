#include "v4l2_system.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include "dio/clock.h"

static int kernel_open(void *context, const char *path, int flags)
{
	(void)context;
	return open(path, flags);
}

static int kernel_close(void *context, int fd)
{
	(void)context;
	return close(fd);
}

static int kernel_ioctl(void *context, int fd, unsigned long request, void *argument)
{
	int result;

	(void)context;
	do
		result = ioctl(fd, request, argument);
	while (result < 0 && errno == EINTR);
	return result;
}

static void *kernel_map(void *context, size_t size, int fd, off_t offset)
{
	(void)context;
	/* Some drivers refuse read-only mappings of capture buffers. */
	return mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, offset);
}

static int kernel_unmap(void *context, void *memory, size_t size)
{
	(void)context;
	return munmap(memory, size);
}

static int kernel_poll(void *context, struct pollfd *fd, int timeout_ms)
{
	(void)context;
	return poll(fd, 1, timeout_ms);
}

static uint64_t kernel_now_ns(void *context)
{
	(void)context;
	return dio_clock_ns();
}

const struct dio_v4l2_system dio_v4l2_kernel = {
	.open = kernel_open,
	.close = kernel_close,
	.ioctl = kernel_ioctl,
	.map = kernel_map,
	.unmap = kernel_unmap,
	.poll = kernel_poll,
	.now_ns = kernel_now_ns,
};
