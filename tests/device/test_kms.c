/* The KMS display on a real card: flips at the rate of the screen, unplugging, mastership. */
#include "check.h"

#include <glob.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "device.h"
#include "dio/clock.h"
#include "dio/display.h"

#define S_NS     1000000000
#define PICTURES 120
/* A machine that is emulated need not show them all. */
#define ENOUGH    10
#define ENOUGH_NS (4 * (uint64_t)S_NS)
#define FIELD_MAX 512

struct fixture {
	struct dio_display *display;
	struct dio_display_event event;
	struct dio_display_info info;
	struct dio_error error;
	struct dio_picture picture;
};

static int set_up(void **state)
{
	static struct fixture fixture;
	const struct dio_display_options options = {.smooth = true};

	fixture = (struct fixture){0};
	*state = &fixture;
	if (dio_display_open("kms", &options, &fixture.display, &fixture.error) != DIO_OK) {
		fprintf(stderr, "%s\n", fixture.error.text);
		return -1;
	}
	dio_display_get_info(fixture.display, &fixture.info);
	printf("%s: %ux%u at %.2f Hz\n", fixture.info.name, fixture.info.width, fixture.info.height,
	       fixture.info.refresh_hz);
	return dio_picture_init(&fixture.picture, 320, 240) == DIO_OK ? 0 : -1;
}

static int tear_down(void **state)
{
	struct fixture *fixture = *state;

	dio_picture_deinit(&fixture->picture);
	return dio_display_close(fixture->display, NULL) == DIO_OK ? 0 : -1;
}

/* Grey levels that change with the tag, and a red, a green and a blue corner. */
static void draw(struct dio_picture *picture, uint64_t tag)
{
	static const uint8_t corners[3][3] = {{255, 0, 0}, {0, 255, 0}, {0, 0, 255}};

	for (uint32_t y = 0; y < picture->height; y++)
		for (uint32_t x = 0; x < picture->width; x++)
			memset(picture->rgb + 3 * ((size_t)picture->width * y + x),
			       (int)((x + y + 2 * tag) & 255), 3);
	for (uint32_t i = 0; i < 3; i++)
		for (uint32_t y = 0; y < 40; y++)
			for (uint32_t x = 0; x < 40; x++)
				memcpy(picture->rgb + 3 * ((size_t)picture->width * y + x + 40 * i),
				       corners[i], 3);
}

static void expect_kind(struct fixture *fixture, enum dio_display_event_kind kind)
{
	assert_ok(dio_display_poll(fixture->display, 10 * (int64_t)S_NS, &fixture->event,
				   &fixture->error),
		  fixture->error);
	assert_int_equal(fixture->event.kind, kind);
}

static bool is_enough(uint64_t pictures, uint64_t elapsed_ns)
{
	return pictures > ENOUGH && elapsed_ns > ENOUGH_NS;
}

static void pictures_flip_in_order_with_times_that_rise(void **state)
{
	struct fixture *fixture = *state;
	uint64_t first_ns = 0, last_ns = 0, tag;
	struct dio_display_counters counters;

	assert_int_equal(fixture->info.state, DIO_DISPLAY_ON);
	for (tag = 1; tag <= PICTURES && !is_enough(tag, last_ns - first_ns); tag++) {
		draw(&fixture->picture, tag);
		assert_ok(
			dio_display_show(fixture->display, &fixture->picture, tag, &fixture->error),
			fixture->error);
		expect_kind(fixture, DIO_DISPLAY_FLIPPED);
		assert_int_equal(fixture->event.tag, tag);
		assert_true(fixture->event.time_ns > last_ns);
		last_ns = fixture->event.time_ns;
		if (tag == 1)
			first_ns = last_ns;
	}
	dio_display_get_counters(fixture->display, &counters);
	assert_int_equal(counters.shown, tag - 1);
	assert_int_equal(counters.replaced, 0);
	printf("%lu flips, %.2f a second\n", (unsigned long)(tag - 1),
	       (double)(tag - 2) * 1e9 / (double)(last_ns - first_ns));
}

static void pictures_faster_than_the_screen_are_replaced_never_waited_for(void **state)
{
	struct fixture *fixture = *state;
	struct dio_display_counters counters;
	const uint64_t begin_ns = dio_clock_ns();
	uint64_t seen = 0, last = 0, tag;

	for (tag = 1; tag <= PICTURES && !is_enough(tag, dio_clock_ns() - begin_ns); tag++) {
		draw(&fixture->picture, tag);
		assert_ok(
			dio_display_show(fixture->display, &fixture->picture, tag, &fixture->error),
			fixture->error);
		while (dio_display_poll(fixture->display, 0, &fixture->event, &fixture->error) ==
		       DIO_OK) {
			assert_true(fixture->event.tag > last);
			last = fixture->event.tag;
			seen++;
		}
	}
	while (last != tag - 1) {
		expect_kind(fixture, DIO_DISPLAY_FLIPPED);
		last = fixture->event.tag;
		seen++;
	}
	dio_display_get_counters(fixture->display, &counters);
	assert_int_equal(counters.shown, seen);
	assert_int_equal(counters.shown + counters.replaced, tag - 1);
	printf("%lu shown, %lu replaced\n", (unsigned long)counters.shown,
	       (unsigned long)counters.replaced);
}

static void second_master_is_refused(void **state)
{
	struct fixture *fixture = *state;
	struct dio_display *second = NULL;
	char spec[160] = "kms:";

	/* "kms /dev/dri/card0 NAME" */
	sscanf(fixture->info.name, "kms %127s", spec + 4);
	assert_fails(dio_display_open(spec, NULL, &second, &fixture->error), DIO_BUSY,
		     fixture->error, "another program has the screen");
}

/* A file of the connector in use, by /sys. */
static void find_file(const struct fixture *fixture, const char *file, char *path)
{
	char card[64] = "", connector[64] = "";

	assert_int_equal(sscanf(fixture->info.name, "kms /dev/dri/%63s %63s", card, connector), 2);
	snprintf(path, FIELD_MAX, "/sys/class/drm/%s-%s/%s", card, connector, file);
}

/* Force the connector's state, and say so as an interrupt would. */
static void plug(const struct fixture *fixture, const char *word)
{
	char card[64] = "", status[FIELD_MAX], event[FIELD_MAX];

	find_file(fixture, "status", status);
	sscanf(fixture->info.name, "kms /dev/dri/%63s", card);
	snprintf(event, sizeof(event), "/sys/class/drm/%s/uevent", card);
	assert_true(device_write(status, word));
	assert_true(device_write(event, "change"));
}

/* Other news may come in between. */
static void expect_state(struct fixture *fixture, enum dio_display_state expected)
{
	struct dio_display_info info;

	do {
		assert_ok(dio_display_poll(fixture->display, 10 * (int64_t)S_NS, &fixture->event,
					   &fixture->error),
			  fixture->error);
		dio_display_get_info(fixture->display, &info);
	} while (info.state != expected);
}

static void screen_is_unplugged_and_plugged_in_twenty_times(void **state)
{
	struct fixture *fixture = *state;
	struct dio_display_counters counters;

	for (uint64_t i = 1; i <= 20; i++) {
		plug(fixture, "off");
		expect_state(fixture, DIO_DISPLAY_OFF);
		assert_int_equal(
			dio_display_show(fixture->display, &fixture->picture, 1, &fixture->error),
			DIO_NO_SIGNAL);
		plug(fixture, "detect");
		expect_state(fixture, DIO_DISPLAY_ON);
		assert_ok(dio_display_show(fixture->display, &fixture->picture, i, &fixture->error),
			  fixture->error);
		do
			assert_ok(dio_display_poll(fixture->display, 10 * (int64_t)S_NS,
						   &fixture->event, &fixture->error),
				  fixture->error);
		while (fixture->event.kind != DIO_DISPLAY_FLIPPED);
		assert_int_equal(fixture->event.tag, i);
	}
	dio_display_get_counters(fixture->display, &counters);
	assert_int_equal(counters.shown, 20);
}

/* For who compares the picture from outside: leaves it on while a file named by DIO_HOLD exists. */
static void picture_stays_while_it_is_looked_at(void **state)
{
	struct fixture *fixture = *state;
	const char *hold = getenv("DIO_HOLD");

	if (!hold)
		skip();
	draw(&fixture->picture, 0);
	assert_ok(dio_display_show(fixture->display, &fixture->picture, 1, &fixture->error),
		  fixture->error);
	expect_kind(fixture, DIO_DISPLAY_FLIPPED);
	printf("showing\n");
	fflush(stdout);
	while (access(hold, F_OK) == 0)
		dio_display_poll(fixture->display, S_NS / 10, &fixture->event, &fixture->error);
}

#define on_card(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		on_card(pictures_flip_in_order_with_times_that_rise),
		on_card(pictures_faster_than_the_screen_are_replaced_never_waited_for),
		on_card(second_master_is_refused),
		on_card(screen_is_unplugged_and_plugged_in_twenty_times),
		on_card(picture_stays_while_it_is_looked_at),
	};
	struct dio_error error;

	if (!device_tests_may_run("the screen"))
		return DEVICE_SKIPPED;
	if (dio_display_check("kms", NULL, true, &error) != DIO_OK) {
		printf("skipped: %s\n", error.text);
		return DEVICE_SKIPPED;
	}
	return cmocka_run_group_tests(tests, NULL, NULL);
}
