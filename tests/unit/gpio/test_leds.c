#include "check.h"

#include <poll.h>
#include <string.h>

#include "fake_gpio.h"
#include "led_pattern.h"

#define MS 1000000u

static const struct dio_led_options LEDS[] = {
	{.name = "state",
	 .line = {.name = "A0"},
	 .patterns = {[DIO_LED_STATE_VIEW] = DIO_LED_ON, [DIO_LED_STATE_CAPTURE] = DIO_LED_TWICE}},
	{.name = "error",
	 .line = {.name = "A1"},
	 .active_low = true,
	 .patterns = {[DIO_LED_STATE_ERROR] = DIO_LED_FAST}},
};

struct fixture {
	struct fake_gpio fake;
	struct dio_leds *leds;
	struct dio_error error;
};

static int set_up(void **state)
{
	static struct fixture fixture;

	fixture = (struct fixture){0};
	fake_gpio_init(&fixture.fake);
	*state = &fixture;
	return dio_leds_open_on(&fixture.fake.system, LEDS, 2, &fixture.leds, &fixture.error) ==
			       DIO_OK
		       ? 0
		       : -1;
}

static int tear_down(void **state)
{
	struct fixture *fixture = *state;

	dio_leds_close(fixture->leds);
	return fake_gpio_in_use(&fixture->fake) ? -1 : 0;
}

/* Lit or not, as the world sees it. */
static bool is_lit(struct fixture *fixture, const char *line)
{
	struct fake_line *led = fake_gpio_line(&fixture->fake, line);

	return led->level != led->request.active_low;
}

static void set_state(struct fixture *fixture, enum dio_led_state state)
{
	assert_ok(dio_leds_set_state(fixture->leds, state, &fixture->error), fixture->error);
}

static void leds_begin_dark(void **state)
{
	assert_false(is_lit(*state, "A0"));
	assert_false(is_lit(*state, "A1"));
}

static void each_state_shows_its_pattern(void **state)
{
	struct fixture *fixture = *state;

	set_state(fixture, DIO_LED_STATE_VIEW);
	assert_true(is_lit(fixture, "A0"));
	assert_false(is_lit(fixture, "A1"));
	set_state(fixture, DIO_LED_STATE_ERROR);
	assert_false(is_lit(fixture, "A0"));
	assert_true(is_lit(fixture, "A1"));
	set_state(fixture, DIO_LED_STATE_IDLE);
	assert_false(is_lit(fixture, "A0"));
	assert_false(is_lit(fixture, "A1"));
}

static void pattern_goes_on_as_time_passes(void **state)
{
	static const struct {
		double ms;
		bool lit;
	} steps[] = {{49, true},   {50, false},  {199, false}, {200, true},   {249, true},
		     {250, false}, {999, false}, {1000, true}, {1050, false}, {86400200, true}};
	struct fixture *fixture = *state;

	set_state(fixture, DIO_LED_STATE_CAPTURE);
	for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
		fake_gpio_at(&fixture->fake, 1000 + steps[i].ms);
		assert_ok(dio_leds_update(fixture->leds, &fixture->error), fixture->error);
		assert_int_equal(is_lit(fixture, "A0"), steps[i].lit);
	}
}

static void steady_led_is_driven_once_and_needs_no_waking(void **state)
{
	struct fixture *fixture = *state;
	struct pollfd waiting = {.fd = dio_leds_get_fd(fixture->leds), .events = POLLIN};

	set_state(fixture, DIO_LED_STATE_VIEW);
	for (int i = 0; i < 5; i++) {
		fake_gpio_at(&fixture->fake, 2000 + 333 * i);
		assert_ok(dio_leds_update(fixture->leds, &fixture->error), fixture->error);
		set_state(fixture, DIO_LED_STATE_VIEW);
	}
	assert_int_equal(fake_gpio_line(&fixture->fake, "A0")->sets, 1);
	assert_int_equal(poll(&waiting, 1, 0), 0);
}

static void descriptor_wakes_for_the_next_step(void **state)
{
	struct fixture *fixture = *state;
	struct pollfd waiting = {.fd = dio_leds_get_fd(fixture->leds), .events = POLLIN};

	/* The timer runs on the real clock, and the fake one says that is long past. */
	set_state(fixture, DIO_LED_STATE_CAPTURE);
	assert_int_equal(poll(&waiting, 1, 1000), 1);
	set_state(fixture, DIO_LED_STATE_VIEW);
	assert_int_equal(poll(&waiting, 1, 0), 0);
}

static void closing_switches_off(void **state)
{
	struct fixture *fixture = *state;

	set_state(fixture, DIO_LED_STATE_ERROR);
	assert_true(is_lit(fixture, "A1"));
	dio_leds_close(fixture->leds);
	fixture->leds = NULL;
	assert_false(is_lit(fixture, "A1"));
}

static void chip_that_goes_away_is_told(void **state)
{
	struct fixture *fixture = *state;

	fixture->fake.gone = true;
	assert_fails(dio_leds_set_state(fixture->leds, DIO_LED_STATE_VIEW, &fixture->error),
		     DIO_GONE, fixture->error, "led state");
}

static void line_that_is_missing_is_named(void **state)
{
	struct fixture *fixture = *state;
	const struct dio_led_options lost = {.name = "power", .line = {.name = "Z9"}};
	struct dio_leds *leds = NULL;

	assert_fails(dio_leds_open_on(&fixture->fake.system, &lost, 1, &leds, &fixture->error),
		     DIO_NOT_FOUND, fixture->error, "led power: line Z9");
	assert_null(leds);
}

/* The step told as next is the one where the light changes, for every pattern. */
static void next_step_is_where_the_light_changes(void **state)
{
	(void)state;
	for (int pattern = 0; pattern < DIO_LED_PATTERN_COUNT; pattern++) {
		uint64_t next_ns = 0, later_ns;
		bool lit = dio_led_pattern_at(pattern, 0, &next_ns);

		assert_non_null(dio_led_pattern_name(pattern));
		for (int step = 0; step < 20 && next_ns != UINT64_MAX; step++) {
			assert_int_equal(dio_led_pattern_at(pattern, next_ns - 1, &later_ns), lit);
			assert_int_equal(later_ns, next_ns);
			assert_int_not_equal(dio_led_pattern_at(pattern, next_ns, &later_ns), lit);
			lit = !lit;
			assert_true(later_ns > next_ns);
			next_ns = later_ns;
		}
	}
}

#define over_fake(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		over_fake(leds_begin_dark),
		over_fake(each_state_shows_its_pattern),
		over_fake(pattern_goes_on_as_time_passes),
		over_fake(steady_led_is_driven_once_and_needs_no_waking),
		over_fake(descriptor_wakes_for_the_next_step),
		over_fake(closing_switches_off),
		over_fake(chip_that_goes_away_is_told),
		over_fake(line_that_is_missing_is_named),
		cmocka_unit_test(next_step_is_where_the_light_changes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
