/* The display loop on a display that the test changes: the linker puts it in place of
 * dio_display_*(). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "dio/clock.h"
#include "viewd/viewd.h"

#define WRAP(name)  __wrap_dio_display_##name
#define PATIENCE_US UINT64_C(20000000)
#define A_MOMENT_US UINT64_C(100000)
#define SIDE        32u

/* One display for all tests. */
struct dio_display {
	int fd;
	struct dio_display_info info;
	bool changed, gone; /* to be told by poll() */
	unsigned shown;
	uint32_t width, height; /* of the picture shown last */
	uint8_t colour;         /* of its middle */
};

static struct dio_display display;
static struct dio_profile profile;
static struct dio_viewd viewd;

enum dio_status WRAP(open)(const char *spec, const struct dio_display_options *options,
			   struct dio_display **opened, struct dio_error *error);
enum dio_status WRAP(close)(struct dio_display *closed, struct dio_error *error);
int WRAP(get_fd)(const struct dio_display *from);
void WRAP(get_info)(const struct dio_display *from, struct dio_display_info *info);
enum dio_status WRAP(show)(struct dio_display *on, const struct dio_picture *picture, uint64_t tag,
			   struct dio_error *error);
enum dio_status WRAP(poll)(struct dio_display *from, int64_t timeout_ns,
			   struct dio_display_event *event, struct dio_error *error);

enum dio_status WRAP(open)(const char *spec, const struct dio_display_options *options,
			   struct dio_display **opened, struct dio_error *error)
{
	(void)spec;
	(void)options;
	(void)error;
	*opened = &display;
	return DIO_OK;
}

enum dio_status WRAP(close)(struct dio_display *closed, struct dio_error *error)
{
	(void)closed;
	(void)error;
	return DIO_OK;
}

int WRAP(get_fd)(const struct dio_display *from)
{
	return from->fd;
}

void WRAP(get_info)(const struct dio_display *from, struct dio_display_info *info)
{
	*info = from->info;
}

enum dio_status WRAP(show)(struct dio_display *on, const struct dio_picture *picture, uint64_t tag,
			   struct dio_error *error)
{
	(void)tag;
	(void)error;
	if (on->info.state != DIO_DISPLAY_ON)
		return DIO_NO_SIGNAL;
	on->width = picture->width;
	on->height = picture->height;
	on->colour = picture->rgb[3 * ((size_t)picture->width * picture->height / 2 +
				       picture->width / 2)];
	on->shown++;
	return DIO_OK;
}

enum dio_status WRAP(poll)(struct dio_display *from, int64_t timeout_ns,
			   struct dio_display_event *event, struct dio_error *error)
{
	eventfd_t count;

	(void)timeout_ns;
	eventfd_read(from->fd, &count);
	if (from->gone) {
		from->gone = false;
		return dio_fail(error, DIO_GONE, "display: unplugged");
	}
	if (!from->changed)
		return DIO_AGAIN;
	from->changed = false;
	*event = (struct dio_display_event){.kind = DIO_DISPLAY_CHANGED};
	return DIO_OK;
}

static int on_worker(sd_event_source *source, int fd, uint32_t events, void *context)
{
	(void)source;
	(void)fd;
	(void)events;
	dio_worker_dispatch(context);
	return 0;
}

/* Until so many pictures were shown. */
static void await_shown(unsigned count)
{
	const uint64_t limit_ns = dio_clock_ns() + PATIENCE_US * 1000;

	while (display.shown < count) {
		assert_true(dio_clock_ns() < limit_ns);
		assert_true(sd_event_run(viewd.loop, A_MOMENT_US) >= 0);
	}
}

/* What the display is from now on, as a hot-plug would have it. */
static void change(enum dio_display_state state, uint32_t width, uint32_t height)
{
	display.info.state = state;
	display.info.width = width;
	display.info.height = height;
	display.changed = true;
	eventfd_write(display.fd, 1);
	assert_true(sd_event_run(viewd.loop, PATIENCE_US) > 0);
}

/* A scene is viewed by a hand that holds still: no picture is due, and the camera's do not count.
 */
static int setup(void **state)
{
	struct dio_error error;

	(void)state;
	dio_profile_init(&profile);
	profile.display.overlay = false;
	display = (struct dio_display){
		.fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK),
		.info = {.name = "scripted", .width = SIDE, .height = SIDE},
	};
	viewd = (struct dio_viewd){.profile = &profile,
				   .bus_address = "none",
				   .engine_ready = true,
				   .scene_there = true,
				   .machine = {.state = DIO_VIEWD_VIEW},
				   .viewpoint = {.by_hand = true}};
	viewd.tracked.camera = DIO_CAPTURE_STREAMING;
	viewd.shot.is_there = true;
	if (display.fd < 0 || sd_event_new(&viewd.loop) < 0 ||
	    dio_worker_create("screen", &viewd.screen, &error) != DIO_OK ||
	    dio_picture_init(&viewd.shot.picture, SIDE, SIDE) != DIO_OK ||
	    sd_event_add_io(viewd.loop, NULL, dio_worker_get_fd(viewd.screen), EPOLLIN, on_worker,
			    viewd.screen) < 0)
		return -1;
	memset(viewd.shot.picture.rgb, 99, (size_t)SIDE * SIDE * 3);
	dio_viewd_open_devices(&viewd);
	return 0;
}

static int teardown(void **state)
{
	(void)state;
	viewd.quitting = true;
	dio_worker_destroy(viewd.screen);
	dio_viewd_close_devices(&viewd);
	dio_viewd_release_pictures(&viewd);
	sd_event_unref(viewd.loop);
	close(display.fd);
	return 0;
}

static void a_still_picture_follows_the_display_through_its_modes(void **state)
{
	(void)state;
	await_shown(1);
	assert_int_equal(display.width, SIDE);
	change(DIO_DISPLAY_ON, 3 * SIDE, 3 * SIDE);
	await_shown(2);
	assert_int_equal(display.width, 3 * SIDE);
	assert_int_equal(display.colour, 99);
}

static void a_still_picture_is_there_when_the_screen_comes_back(void **state)
{
	(void)state;
	await_shown(1);
	change(DIO_DISPLAY_OFF, 0, 0);
	dio_viewd_show_tick(&viewd);
	assert_int_equal(display.shown, 1);
	change(DIO_DISPLAY_ON, 2 * SIDE, SIDE);
	await_shown(2);
	assert_int_equal(display.width, 2 * SIDE);
	assert_int_equal(display.colour, 99);
}

static void a_still_picture_is_there_when_the_card_comes_back(void **state)
{
	(void)state;
	await_shown(1);
	display.gone = true;
	eventfd_write(display.fd, 1);
	assert_true(sd_event_run(viewd.loop, PATIENCE_US) > 0);
	assert_null(viewd.display);
	viewd.devices_due_ns = 0;
	dio_viewd_open_devices(&viewd);
	await_shown(2);
	assert_int_equal(display.colour, 99);
}

static void words_over_a_still_picture_are_brought_up_to_date(void **state)
{
	(void)state;
	await_shown(1);
	/* Composed since the last tick; then not. */
	dio_viewd_show_tick(&viewd);
	assert_int_equal(display.shown, 1);
	viewd.shot.taken_ns = 5;
	dio_viewd_show_tick(&viewd);
	await_shown(2);
	dio_viewd_show_tick(&viewd);
	dio_viewd_show_tick(&viewd);
	await_shown(3);
	/* Only the first of them tells how late the picture was. */
	assert_int_equal(viewd.tags_taken_ns[1], 5);
	assert_int_equal(viewd.tags_taken_ns[2], 0);
}

#define display_test(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		display_test(a_still_picture_follows_the_display_through_its_modes),
		display_test(a_still_picture_is_there_when_the_screen_comes_back),
		display_test(a_still_picture_is_there_when_the_card_comes_back),
		display_test(words_over_a_still_picture_are_brought_up_to_date),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
