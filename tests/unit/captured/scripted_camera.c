#include "scripted_camera.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "dio/camera.h"
#include "dio/clock.h"

#define NS_PER_S   1000000000ull
#define WRAP(name) __wrap_dio_camera_##name

struct dio_camera {
	struct script *script;
	struct dio_camera_info info;
	struct dio_camera_counters counters;
	struct dio_frame_metadata metadata;
	uint8_t picture[4 * SCRIPT_SIDE * SCRIPT_SIDE];
	uint64_t due_ns;
};

enum dio_status WRAP(open)(const char *spec, const struct dio_camera_options *options,
			   struct dio_camera **camera, struct dio_error *error);
void WRAP(close)(struct dio_camera *camera);
enum dio_status WRAP(start)(struct dio_camera *camera, struct dio_error *error);
enum dio_status WRAP(acquire)(struct dio_camera *camera, struct dio_frame *frame,
			      int64_t timeout_ns, struct dio_error *error);
void WRAP(get_info)(const struct dio_camera *camera, struct dio_camera_info *info);
void WRAP(get_counters)(const struct dio_camera *camera, struct dio_camera_counters *counters);
enum dio_status WRAP(set_controls)(struct dio_camera *camera, const struct dio_camera_wish *wish,
				   struct dio_camera_controls *done, struct dio_error *error);
enum dio_status WRAP(get_controls)(struct dio_camera *camera, struct dio_camera_controls *now,
				   struct dio_error *error);

static void sleep_until(uint64_t until_ns)
{
	const struct timespec ts = {(time_t)(until_ns / NS_PER_S), (long)(until_ns % NS_PER_S)};

	while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &ts, NULL) != 0)
		;
}

static struct script *map_script(void)
{
	const char *path = getenv(SCRIPT_VARIABLE);
	int fd = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
	void *memory;

	if (fd < 0)
		abort();
	memory = mmap(NULL, sizeof(struct script), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
	close(fd);
	if (memory == MAP_FAILED)
		abort();
	return memory;
}

enum dio_status WRAP(open)(const char *spec, const struct dio_camera_options *options,
			   struct dio_camera **camera, struct dio_error *error)
{
	struct dio_camera *made = calloc(1, sizeof(*made));
	uint32_t mode, side;

	(void)spec;
	(void)options;
	if (!made)
		return DIO_NO_MEM;
	made->script = map_script();
	mode = atomic_load(&made->script->mode);
	if (mode == SCRIPT_ABSENT || mode == SCRIPT_REFUSED) {
		WRAP(close)(made);
		return mode == SCRIPT_ABSENT
			       ? dio_fail(error, DIO_NOT_FOUND, "camera script: is it plugged in?")
			       : dio_fail(error, DIO_UNSUPPORTED, "camera script: no format");
	}
	atomic_fetch_add(&made->script->opened, 1);
	side = atomic_load(&made->script->larger) ? 2 * SCRIPT_SIDE : SCRIPT_SIDE;
	made->info = (struct dio_camera_info){.name = "scripted camera",
					      .format = DIO_PIXEL_GRAY8,
					      .width = side,
					      .height = side,
					      .frames_per_second = 100};
	made->metadata = (struct dio_frame_metadata){.exposure_us = 8000, .gain = 2};
	*camera = made;
	return DIO_OK;
}

void WRAP(close)(struct dio_camera *camera)
{
	if (camera)
		munmap(camera->script, sizeof(*camera->script));
	free(camera);
}

enum dio_status WRAP(start)(struct dio_camera *camera, struct dio_error *error)
{
	(void)error;
	camera->due_ns = dio_clock_ns();
	return DIO_OK;
}

static void paint(struct dio_camera *camera, struct dio_frame *frame)
{
	struct script *script = camera->script;
	const uint64_t number = atomic_fetch_add(&script->frames, 1);
	const uint32_t level = atomic_fetch_add(&script->level, atomic_load(&script->drift)) & 0xff;
	const uint32_t side = camera->info.width;

	memset(camera->picture, (int)level, (size_t)side * side);
	memcpy(camera->picture, &number, sizeof(number));
	*frame = (struct dio_frame){
		.format = DIO_PIXEL_GRAY8,
		.width = side,
		.height = side,
		.pitch_bytes = side,
		.timestamp_ns = camera->due_ns,
		.sequence = number,
		.data = camera->picture,
		.size_bytes = (size_t)side * side,
		.metadata = camera->metadata,
	};
	camera->counters.delivered++;
}

enum dio_status WRAP(acquire)(struct dio_camera *camera, struct dio_frame *frame,
			      int64_t timeout_ns, struct dio_error *error)
{
	const uint64_t until = dio_clock_ns() + (uint64_t)timeout_ns;
	const uint32_t rate = atomic_load(&camera->script->rate);

	switch (atomic_load(&camera->script->mode)) {
	case SCRIPT_ABSENT:
		return dio_fail(error, DIO_GONE, "camera script: unplugged");
	case SCRIPT_BROKEN:
		return dio_fail(error, DIO_IO, "camera script: the driver reports an error");
	case SCRIPT_END:
		return dio_fail(error, DIO_END, "camera script: all frames were delivered");
	case SCRIPT_NO_SIGNAL:
		sleep_until(until);
		return dio_fail(error, DIO_NO_SIGNAL, "camera script: no signal");
	case SCRIPT_SILENT:
	case SCRIPT_REFUSED:
		sleep_until(until);
		return dio_fail(error, DIO_AGAIN, "camera script: no frame");
	case SCRIPT_HANGING:
		for (;;)
			pause();
	default:
		break;
	}
	camera->due_ns += NS_PER_S / (rate ? rate : 100);
	if (camera->due_ns + NS_PER_S < dio_clock_ns())
		camera->due_ns = dio_clock_ns();
	sleep_until(camera->due_ns);
	paint(camera, frame);
	return DIO_OK;
}

void WRAP(get_info)(const struct dio_camera *camera, struct dio_camera_info *info)
{
	*info = camera->info;
}

void WRAP(get_counters)(const struct dio_camera *camera, struct dio_camera_counters *counters)
{
	*counters = camera->counters;
}

enum dio_status WRAP(set_controls)(struct dio_camera *camera, const struct dio_camera_wish *wish,
				   struct dio_camera_controls *done, struct dio_error *error)
{
	uint32_t locked = DIO_LOCK_EXPOSURE | DIO_LOCK_GAIN;

	if (!atomic_load(&camera->script->deaf))
		locked |= DIO_LOCK_WHITE_BALANCE;
	camera->metadata.locked = wish->hold ? locked : 0;
	if (wish->exposure_us)
		camera->metadata.exposure_us = wish->exposure_us;
	atomic_store(&camera->script->held, wish->hold);
	return WRAP(get_controls)(camera, done, error);
}

enum dio_status WRAP(get_controls)(struct dio_camera *camera, struct dio_camera_controls *now,
				   struct dio_error *error)
{
	(void)error;
	*now = (struct dio_camera_controls){.offered = DIO_LOCK_EXPOSURE | DIO_LOCK_GAIN |
						       DIO_LOCK_WHITE_BALANCE,
					    .metadata = camera->metadata};
	return DIO_OK;
}
