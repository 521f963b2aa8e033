/* The recognition of presses: a story of edges in, presses out. Times are in ms. */
#include "check.h"

#include "press.h"

#define MS 1000000u

/* Debounce 10, long 500, double 200. */
static const struct dio_press_times ALL = {
	.debounce_ns = 10 * MS, .long_ns = 500 * MS, .double_ns = 200 * MS};

struct button {
	struct dio_press_state state;
	enum dio_press press;
	uint64_t began_ns;
};

static struct button make(struct dio_press_times times, bool pressed)
{
	struct button button = {0};

	dio_press_init(&button.state, &times, pressed);
	return button;
}

static bool next(struct button *button, uint64_t ms)
{
	return dio_press_next(&button->state, ms * MS, &button->press, &button->began_ns);
}

/* Nothing is certain until then. */
#define assert_nothing(button, ms) assert_false(next(button, ms))

#define assert_press(button, ms, expected, began_ms)                                               \
	do {                                                                                       \
		assert_true(next(button, ms));                                                     \
		assert_int_equal((button)->press, expected);                                       \
		assert_int_equal((button)->began_ns, (uint64_t)(began_ms)*MS);                     \
	} while (0)

static void edge(struct button *button, bool pressed, uint64_t ms)
{
	assert_nothing(button, ms);
	dio_press_edge(&button->state, pressed, ms * MS);
}

static void short_press_is_told_when_no_second_can_follow(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1100);
	assert_nothing(&button, 1299);
	assert_press(&button, 1300, DIO_PRESS_SHORT, 1000);
	assert_nothing(&button, 9999);
}

static void short_press_is_told_at_its_release_when_there_is_no_double(void **state)
{
	struct button button = make((struct dio_press_times){.long_ns = 500 * MS}, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1100);
	assert_press(&button, 1100, DIO_PRESS_SHORT, 1000);
	assert_nothing(&button, 9999);
}

static void release_is_debounced_before_it_is_told(void **state)
{
	struct button button = make((struct dio_press_times){.debounce_ns = 10 * MS}, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1100);
	assert_nothing(&button, 1109);
	assert_press(&button, 1110, DIO_PRESS_SHORT, 1000);
}

static void long_press_is_told_while_held_and_its_release_is_nothing(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	assert_nothing(&button, 1499);
	assert_press(&button, 1500, DIO_PRESS_LONG, 1000);
	edge(&button, false, 3000);
	assert_nothing(&button, 9999);
	edge(&button, true, 10000);
	edge(&button, false, 10050);
	assert_press(&button, 10250, DIO_PRESS_SHORT, 10000);
}

static void release_just_before_long_is_short(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1499);
	/* The release settles after 1500, yet it happened before. */
	assert_nothing(&button, 1698);
	assert_press(&button, 1699, DIO_PRESS_SHORT, 1000);
}

static void second_press_in_time_is_double_and_told_at_once(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1080);
	edge(&button, true, 1200);
	assert_press(&button, 1210, DIO_PRESS_DOUBLE, 1000);
	edge(&button, false, 1300);
	assert_nothing(&button, 9999);
}

static void second_press_held_is_double_and_no_long(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1080);
	edge(&button, true, 1200);
	assert_press(&button, 1210, DIO_PRESS_DOUBLE, 1000);
	assert_nothing(&button, 5000);
	edge(&button, false, 5000);
	assert_nothing(&button, 9999);
}

static void second_press_too_late_makes_two_short_ones(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1080);
	assert_press(&button, 1300, DIO_PRESS_SHORT, 1000);
	edge(&button, true, 1300);
	edge(&button, false, 1350);
	assert_press(&button, 1600, DIO_PRESS_SHORT, 1300);
}

static void events_read_late_count_by_their_own_times(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	/* The owner slept: four edges come at once, at 5000. */
	dio_press_edge(&button.state, true, 1000 * (uint64_t)MS);
	assert_nothing(&button, 1080);
	dio_press_edge(&button.state, false, 1080 * (uint64_t)MS);
	assert_press(&button, 2000, DIO_PRESS_SHORT, 1000);
	assert_nothing(&button, 2000);
	dio_press_edge(&button.state, true, 2000 * (uint64_t)MS);
	assert_press(&button, 2600, DIO_PRESS_LONG, 2000);
	assert_nothing(&button, 5000);
}

static void bounces_are_one_press_from_the_first_touch(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1002);
	edge(&button, true, 1003);
	edge(&button, false, 1007);
	edge(&button, true, 1009);
	assert_nothing(&button, 1018);
	edge(&button, false, 1100);
	edge(&button, true, 1104);
	edge(&button, false, 1105);
	assert_press(&button, 1305, DIO_PRESS_SHORT, 1000);
	assert_nothing(&button, 9999);
}

static void glitch_shorter_than_the_debounce_is_nothing(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1009);
	assert_nothing(&button, 9999);
	assert_true(dio_press_deadline(&button.state) == DIO_PRESS_NEVER);
}

static void glitch_while_held_does_not_stop_the_long_press(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	edge(&button, false, 1495);
	edge(&button, true, 1502);
	assert_press(&button, 1502, DIO_PRESS_LONG, 1000);
}

static void button_held_from_before_is_no_press(void **state)
{
	struct button button = make(ALL, true);

	(void)state;
	assert_nothing(&button, 5000);
	edge(&button, false, 5000);
	assert_nothing(&button, 6000);
	edge(&button, true, 6000);
	assert_press(&button, 6500, DIO_PRESS_LONG, 6000);
}

static void deadline_is_when_something_becomes_certain(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	assert_true(dio_press_deadline(&button.state) == DIO_PRESS_NEVER);
	edge(&button, true, 1000);
	assert_int_equal(dio_press_deadline(&button.state), (uint64_t)1010 * MS);
	assert_nothing(&button, 1010);
	assert_int_equal(dio_press_deadline(&button.state), (uint64_t)1500 * MS);
	edge(&button, false, 1495);
	/* Until the release has settled it is not known whether the press is long. */
	assert_int_equal(dio_press_deadline(&button.state), (uint64_t)1505 * MS);
	assert_nothing(&button, 1505);
	assert_int_equal(dio_press_deadline(&button.state), (uint64_t)1695 * MS);
}

static void time_running_backwards_does_no_harm(void **state)
{
	struct button button = make(ALL, false);

	(void)state;
	edge(&button, true, 1000);
	assert_nothing(&button, 1100);
	dio_press_edge(&button.state, false, 900 * (uint64_t)MS);
	assert_nothing(&button, 1199);
	assert_press(&button, 1200, DIO_PRESS_SHORT, 1000);
}

/* Whenever the owner looks, the same edges give the same presses. */
static void looking_more_often_changes_nothing(void **state)
{
	uint32_t seed = 7;

	(void)state;
	for (int round = 0; round < 200; round++) {
		struct button often = make(ALL, false), rarely = make(ALL, false);
		uint64_t at = 1000, seen_often = 0, seen_rarely = 0;
		uint32_t often_count = 0, rarely_count = 0;
		bool pressed = false;

		for (int i = 0; i < 50; i++) {
			seed = seed * 1664525u + 1013904223u;
			const uint64_t gap = 1 + (seed >> 16) % (seed >> 30 ? 300 : 12);

			for (uint64_t t = at; t <= at + gap; t++)
				while (next(&often, t)) {
					often_count++;
					seen_often = seen_often * 31 + often.press + often.began_ns;
				}
			at += gap;
			pressed = !pressed;
			while (next(&rarely, at)) {
				rarely_count++;
				seen_rarely = seen_rarely * 31 + rarely.press + rarely.began_ns;
			}
			dio_press_edge(&often.state, pressed, at * MS);
			dio_press_edge(&rarely.state, pressed, at * MS);
		}
		assert_int_equal(often_count, rarely_count);
		assert_int_equal(seen_often, seen_rarely);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(short_press_is_told_when_no_second_can_follow),
		cmocka_unit_test(short_press_is_told_at_its_release_when_there_is_no_double),
		cmocka_unit_test(release_is_debounced_before_it_is_told),
		cmocka_unit_test(long_press_is_told_while_held_and_its_release_is_nothing),
		cmocka_unit_test(release_just_before_long_is_short),
		cmocka_unit_test(second_press_in_time_is_double_and_told_at_once),
		cmocka_unit_test(second_press_held_is_double_and_no_long),
		cmocka_unit_test(second_press_too_late_makes_two_short_ones),
		cmocka_unit_test(events_read_late_count_by_their_own_times),
		cmocka_unit_test(bounces_are_one_press_from_the_first_touch),
		cmocka_unit_test(glitch_shorter_than_the_debounce_is_nothing),
		cmocka_unit_test(glitch_while_held_does_not_stop_the_long_press),
		cmocka_unit_test(button_held_from_before_is_no_press),
		cmocka_unit_test(deadline_is_when_something_becomes_certain),
		cmocka_unit_test(time_running_backwards_does_no_harm),
		cmocka_unit_test(looking_more_often_changes_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
