#include "check.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "fake_kms.h"

#define S_NS 1000000000

struct fixture {
	struct fake_kms fake;
	struct dio_display *display;
	struct dio_display_options options;
	struct dio_display_mode mode;
	struct dio_display_event event;
	struct dio_display_info info;
	struct dio_display_counters counters;
	struct dio_error error;
	struct dio_picture picture;
};

static int set_up(void **state)
{
	struct fixture *fixture = calloc(1, sizeof(*fixture));

	fake_kms_init(&fixture->fake);
	*state = fixture;
	return dio_picture_init(&fixture->picture, 192, 108) == DIO_OK ? 0 : -1;
}

/* Whatever a test did, all is given back. */
static int tear_down(void **state)
{
	struct fixture *fixture = *state;
	bool clean;

	dio_display_close(fixture->display, NULL);
	clean = fixture->fake.opened == 0 && fixture->fake.created == fixture->fake.destroyed;
	fake_kms_deinit(&fixture->fake);
	dio_picture_deinit(&fixture->picture);
	free(fixture);
	return clean ? 0 : -1;
}

static enum dio_status open_display(struct fixture *fixture, const char *card)
{
	return dio_display_open_kms_on(&fixture->fake.system, card, &fixture->mode,
				       &fixture->options, &fixture->display, &fixture->error);
}

/* A picture of one grey, its shade told by the tag. */
static enum dio_status show(struct fixture *fixture, uint8_t tag)
{
	memset(fixture->picture.rgb, tag, 3 * (size_t)192 * 108);
	return dio_display_show(fixture->display, &fixture->picture, tag, &fixture->error);
}

static enum dio_status poll_event(struct fixture *fixture, int64_t timeout_ns)
{
	return dio_display_poll(fixture->display, timeout_ns, &fixture->event, &fixture->error);
}

static void expect_flip(struct fixture *fixture, uint64_t tag, uint64_t time_ns)
{
	assert_ok(poll_event(fixture, 0), fixture->error);
	assert_int_equal(fixture->event.kind, DIO_DISPLAY_FLIPPED);
	assert_int_equal(fixture->event.tag, tag);
	assert_int_equal(fixture->event.time_ns, time_ns);
	assert_int_equal(fake_kms_pixel(&fixture->fake), tag * 0x010101u);
}

static void expect_state(struct fixture *fixture, enum dio_display_state expected)
{
	assert_ok(poll_event(fixture, 0), fixture->error);
	assert_int_equal(fixture->event.kind, DIO_DISPLAY_CHANGED);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_int_equal(fixture->info.state, expected);
	assert_int_equal(fixture->info.width != 0, expected == DIO_DISPLAY_ON);
}

static void expect_counters(struct fixture *fixture, uint64_t shown, uint64_t replaced,
			    uint64_t lost)
{
	dio_display_get_counters(fixture->display, &fixture->counters);
	assert_int_equal(fixture->counters.shown, shown);
	assert_int_equal(fixture->counters.replaced, replaced);
	assert_int_equal(fixture->counters.lost, lost);
}

static void screen_comes_on_black_in_its_preferred_mode(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_int_equal(fixture->info.state, DIO_DISPLAY_ON);
	assert_int_equal(fixture->info.width, 192);
	assert_int_equal(fixture->info.height, 108);
	assert_true(fixture->info.refresh_hz > 59.9 && fixture->info.refresh_hz < 60.1);
	assert_string_equal(fixture->info.name, "kms /dev/dri/card0 HDMI-A-1");
	assert_int_equal(fake_kms_pixel(&fixture->fake), 0);
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
}

static void picture_is_on_the_screen_at_the_vertical_blank(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	assert_ok(show(fixture, 1), fixture->error);
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
	fake_kms_vblank(&fixture->fake, 1234);
	expect_flip(fixture, 1, 1234);
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
	expect_counters(fixture, 1, 0, 0);
}

static void one_flip_is_in_flight_and_the_newest_picture_follows_it(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	for (uint8_t tag = 1; tag <= 5; tag++)
		assert_ok(show(fixture, tag), fixture->error);
	fake_kms_vblank(&fixture->fake, 10);
	expect_flip(fixture, 1, 10);
	/* 2, 3 and 4 were passed over; 5 went on its way when 1 arrived. */
	fake_kms_vblank(&fixture->fake, 20);
	expect_flip(fixture, 5, 20);
	assert_int_equal(fixture->fake.flipping, 0);
	expect_counters(fixture, 2, 3, 0);
}

static void slots_go_round_without_tearing(void **state)
{
	struct fixture *fixture = *state;

	/* The fake aborts when a buffer on the screen is flipped to or two flips are in flight. */
	assert_ok(open_display(fixture, ""), fixture->error);
	for (uint8_t tag = 1; tag < 100; tag++) {
		uint32_t before = fake_kms_pixel(&fixture->fake);

		assert_ok(show(fixture, tag), fixture->error);
		/* Drawing does not touch what is seen. */
		assert_int_equal(fake_kms_pixel(&fixture->fake), before);
		if (tag % 3 == 0)
			continue;
		fake_kms_vblank(&fixture->fake, tag);
		assert_ok(poll_event(fixture, 0), fixture->error);
	}
	assert_int_equal(fixture->fake.created, 3);
}

static void busy_card_is_tried_again(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	fixture->fake.flip_errno = EBUSY;
	assert_ok(show(fixture, 7), fixture->error);
	assert_int_equal(fixture->fake.flipping, 0);
	fixture->fake.flip_errno = 0;
	/* The retry's timer is milliseconds; nothing else wakes it. */
	struct pollfd waiting = {.fd = dio_display_get_fd(fixture->display), .events = POLLIN};
	assert_int_equal(poll(&waiting, 1, 1000), 1);
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
	assert_int_not_equal(fixture->fake.flipping, 0);
	fake_kms_vblank(&fixture->fake, 5);
	expect_flip(fixture, 7, 5);
}

static void unplugged_screen_is_a_state_and_plugging_in_recovers(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	for (int i = 0; i < 20; i++) {
		assert_ok(show(fixture, 1), fixture->error);
		assert_ok(show(fixture, 2), fixture->error);
		fake_kms_plug(&fixture->fake, false);
		expect_state(fixture, DIO_DISPLAY_OFF);
		assert_false(fixture->fake.is_on);
		assert_int_equal(show(fixture, 3), DIO_NO_SIGNAL);
		assert_int_equal(fixture->fake.created, fixture->fake.destroyed);
		fake_kms_plug(&fixture->fake, true);
		expect_state(fixture, DIO_DISPLAY_ON);
		assert_ok(show(fixture, 4), fixture->error);
		fake_kms_vblank(&fixture->fake, 9);
		expect_flip(fixture, 4, 9);
	}
	expect_counters(fixture, 20, 0, 40);
}

static void flip_of_before_the_unplugging_is_nobodys(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	assert_ok(show(fixture, 1), fixture->error);
	const struct dio_kms_flip late = {.cookie = fixture->fake.cookie, .time_ns = 5};
	fake_kms_plug(&fixture->fake, false);
	expect_state(fixture, DIO_DISPLAY_OFF);
	fake_kms_plug(&fixture->fake, true);
	expect_state(fixture, DIO_DISPLAY_ON);
	assert_ok(show(fixture, 2), fixture->error);
	fixture->fake.flips[fixture->fake.flip_count++] = late;
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
	fake_kms_vblank(&fixture->fake, 30);
	expect_flip(fixture, 2, 30);
}

static void display_without_screen_opens_off_and_comes_on_later(void **state)
{
	struct fixture *fixture = *state;

	fixture->fake.cards[0].outputs.connectors[0].connected = false;
	assert_ok(open_display(fixture, ""), fixture->error);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_int_equal(fixture->info.state, DIO_DISPLAY_OFF);
	assert_int_equal(show(fixture, 1), DIO_NO_SIGNAL);
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
	fake_kms_plug(&fixture->fake, true);
	expect_state(fixture, DIO_DISPLAY_ON);
}

static void plug_news_about_the_same_screen_disturbs_nothing(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	assert_ok(show(fixture, 1), fixture->error);
	fake_kms_plug(&fixture->fake, true);
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
	assert_int_equal(fixture->fake.modes_set, 1);
	fake_kms_vblank(&fixture->fake, 3);
	expect_flip(fixture, 1, 3);
}

static void another_screen_gets_its_own_mode(void **state)
{
	struct fixture *fixture = *state;
	struct dio_kms_connector *connector = &fixture->fake.cards[0].outputs.connectors[0];

	assert_ok(open_display(fixture, ""), fixture->error);
	connector->modes[1] = fake_kms_mode(800, 480, 60, true);
	fake_kms_plug(&fixture->fake, true);
	expect_state(fixture, DIO_DISPLAY_ON);
	assert_ok(poll_event(fixture, 0), fixture->error);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_int_equal(fixture->info.width, 800);
	assert_ok(show(fixture, 9), fixture->error);
	fake_kms_vblank(&fixture->fake, 3);
	assert_ok(poll_event(fixture, 0), fixture->error);
	assert_int_equal(fixture->event.tag, 9);
}

static void flip_that_never_comes_starts_the_screen_again(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	assert_ok(show(fixture, 1), fixture->error);
	assert_ok(poll_event(fixture, 5 * (int64_t)S_NS), fixture->error);
	assert_int_equal(fixture->event.kind, DIO_DISPLAY_CHANGED);
	expect_state(fixture, DIO_DISPLAY_ON);
	assert_int_equal(fixture->fake.modes_set, 2);
	assert_ok(show(fixture, 2), fixture->error);
	fake_kms_vblank(&fixture->fake, 3);
	expect_flip(fixture, 2, 3);
	expect_counters(fixture, 1, 0, 1);
}

static void screen_taken_by_another_program_is_away_until_it_can_be_reclaimed(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	fixture->fake.flip_errno = EACCES;
	fixture->fake.reclaim_errno = EBUSY;
	assert_int_equal(show(fixture, 1), DIO_NO_SIGNAL);
	/* Who waits on the descriptor hears of it. */
	struct pollfd waiting = {.fd = dio_display_get_fd(fixture->display), .events = POLLIN};
	assert_int_equal(poll(&waiting, 1, 500), 1);
	expect_state(fixture, DIO_DISPLAY_AWAY);
	assert_int_equal(poll_event(fixture, 3 * (int64_t)S_NS / 2), DIO_AGAIN);
	fixture->fake.flip_errno = fixture->fake.reclaim_errno = 0;
	assert_ok(poll_event(fixture, 5 * (int64_t)S_NS), fixture->error);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_int_equal(fixture->info.state, DIO_DISPLAY_ON);
	assert_ok(show(fixture, 2), fixture->error);
}

static void terminal_is_given_up_and_taken_back(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	assert_ok(show(fixture, 1), fixture->error);
	fake_kms_switch(&fixture->fake, DIO_KMS_TERMINAL_LEAVES);
	expect_state(fixture, DIO_DISPLAY_AWAY);
	assert_int_equal(fixture->fake.released, 1);
	assert_int_equal(show(fixture, 2), DIO_NO_SIGNAL);
	/* Nothing is plugged or asked for while another has the terminal. */
	fake_kms_plug(&fixture->fake, true);
	assert_int_equal(poll_event(fixture, 3 * (int64_t)S_NS / 2), DIO_AGAIN);
	assert_int_equal(fixture->fake.reclaimed, 0);
	fake_kms_switch(&fixture->fake, DIO_KMS_TERMINAL_COMES);
	expect_state(fixture, DIO_DISPLAY_ON);
	assert_int_equal(fixture->fake.reclaimed, 1);
}

static void screen_gone_while_away_is_off_on_return(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	fake_kms_switch(&fixture->fake, DIO_KMS_TERMINAL_LEAVES);
	expect_state(fixture, DIO_DISPLAY_AWAY);
	fake_kms_plug(&fixture->fake, false);
	assert_int_equal(poll_event(fixture, 0), DIO_AGAIN);
	fake_kms_switch(&fixture->fake, DIO_KMS_TERMINAL_COMES);
	expect_state(fixture, DIO_DISPLAY_OFF);
	fake_kms_plug(&fixture->fake, true);
	expect_state(fixture, DIO_DISPLAY_ON);
}

static void closing_puts_back_what_was_shown_before_buffers_go(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	assert_ok(show(fixture, 1), fixture->error);
	assert_ok(dio_display_close(fixture->display, &fixture->error), fixture->error);
	fixture->display = NULL;
	assert_int_equal(fixture->fake.restored, 1);
	assert_true(fixture->fake.restored_before_destroy);
}

static void card_that_is_removed_is_told(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_display(fixture, ""), fixture->error);
	fixture->fake.read_errno = ENODEV;
	assert_fails(poll_event(fixture, 0), DIO_GONE, fixture->error, "/dev/dri/card0");
	fixture->fake.read_errno = 0;
	fixture->fake.flip_errno = ENODEV;
	assert_fails(show(fixture, 1), DIO_GONE, fixture->error, "was removed");
}

static void mode_that_the_card_refuses_is_passed_over(void **state)
{
	struct fixture *fixture = *state;

	fixture->fake.refused_width = 192;
	assert_ok(open_display(fixture, ""), fixture->error);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_int_equal(fixture->info.width, 128);
}

static void card_that_refuses_every_mode_is_told(void **state)
{
	struct fixture *fixture = *state;

	fixture->fake.set_mode_errno = EINVAL;
	assert_int_not_equal(open_display(fixture, ""), DIO_OK);
	assert_non_null(strstr(fixture->error.text, "refuses 128x72"));
	fixture->fake.set_mode_errno = EACCES;
	assert_fails(open_display(fixture, ""), DIO_BUSY, fixture->error, "HDMI-A-1");
}

static void memory_that_runs_out_at_any_slot_is_given_back(void **state)
{
	struct fixture *fixture = *state;

	for (uint32_t at = 1; at <= 3; at++) {
		fixture->fake.create_errno = ENOMEM;
		fixture->fake.create_fails_at = at;
		assert_fails(open_display(fixture, ""), DIO_NO_MEM, fixture->error, "128x72");
		assert_int_equal(fixture->fake.created, fixture->fake.destroyed);
	}
}

static void card_with_a_screen_goes_before_one_without(void **state)
{
	struct fixture *fixture = *state;

	fixture->fake.card_count = 2;
	fixture->fake.cards[0].outputs.connectors[0].connected = false;
	assert_ok(open_display(fixture, ""), fixture->error);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_string_equal(fixture->info.name, "kms /dev/dri/card1 HDMI-A-1");
	assert_int_equal(fixture->fake.opened, 1);
}

static void card_that_only_computes_is_passed_over(void **state)
{
	struct fixture *fixture = *state;

	fixture->fake.card_count = 2;
	fixture->fake.cards[0].open_errno = EOPNOTSUPP;
	assert_ok(open_display(fixture, ""), fixture->error);
	dio_display_get_info(fixture->display, &fixture->info);
	assert_string_equal(fixture->info.name, "kms /dev/dri/card1 HDMI-A-1");
}

static void cards_that_cannot_be_used_are_told_apart(void **state)
{
	static const struct {
		int cause;
		enum dio_status status;
		const char *word;
	} cases[] = {
		{EBUSY, DIO_BUSY, "another program has the screen"},
		{EACCES, DIO_IO, "group video"},
		{EOPNOTSUPP, DIO_UNSUPPORTED, "no screens"},
		{ENOENT, DIO_NOT_FOUND, "/dev/dri/card0"},
	};
	struct fixture *fixture = *state;

	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		fixture->fake.cards[0].open_errno = cases[i].cause;
		assert_fails(open_display(fixture, "/dev/dri/card0"), cases[i].status,
			     fixture->error, cases[i].word);
	}
	fixture->fake.card_count = 0;
	assert_fails(open_display(fixture, ""), DIO_NOT_FOUND, fixture->error, "no graphics card");
}

static void connector_that_is_wished_is_the_only_one_used(void **state)
{
	struct fixture *fixture = *state;
	struct dio_kms_outputs *outputs = &fixture->fake.cards[0].outputs;

	outputs->connector_count = 2;
	outputs->connectors[1] = outputs->connectors[0];
	outputs->connectors[1].id = 31;
	memcpy(outputs->connectors[1].name, "DP-2", 5);
	fixture->options.connector = "DP-2";
	assert_ok(open_display(fixture, ""), fixture->error);
	assert_int_equal(fixture->fake.route.connector_id, 31);
	outputs->connectors[1].connected = false;
	fake_kms_plug(&fixture->fake, true);
	expect_state(fixture, DIO_DISPLAY_OFF);
	dio_display_close(fixture->display, NULL);
	fixture->display = NULL;
	fixture->options.connector = "DSI-1";
	assert_fails(open_display(fixture, ""), DIO_NOT_FOUND, fixture->error, "DSI-1");
}

static void wished_mode_is_taken_where_the_screen_has_it(void **state)
{
	struct fixture *fixture = *state;
	struct dio_kms_outputs *outputs = &fixture->fake.cards[0].outputs;
	struct dio_kms_connector *connector = &outputs->connectors[0];
	struct dio_kms_wish wish = {.mode = {.width = 128, .height = 72}};
	struct dio_kms_route route;
	uint32_t mode;

	connector->modes[2] = fake_kms_mode(128, 72, 50, false);
	connector->modes[3] = fake_kms_mode(192, 108, 50, false);
	connector->modes[3].flags = DRM_MODE_FLAG_INTERLACE;
	connector->mode_count = 4;
	assert_true(dio_kms_choose(outputs, &wish, 0, &route, &mode));
	assert_int_equal(mode, 0);
	wish.mode.refresh_hz = 50;
	assert_true(dio_kms_choose(outputs, &wish, 0, &route, &mode));
	assert_int_equal(mode, 2);
	/* A rate alone, a size that is not offered: the rest is the screen's choice. */
	wish.mode = (struct dio_display_mode){.width = 640, .height = 480};
	assert_true(dio_kms_choose(outputs, &wish, 0, &route, &mode));
	assert_int_equal(mode, 1);
	assert_true(dio_kms_choose(outputs, &wish, 1u << 1, &route, &mode));
	assert_int_equal(mode, 0);
	assert_false(dio_kms_choose(outputs, &wish, 0xf, &route, &mode));
}

static void crtc_in_use_is_kept_and_one_that_cannot_is_not(void **state)
{
	struct fixture *fixture = *state;
	struct dio_kms_outputs *outputs = &fixture->fake.cards[0].outputs;
	const struct dio_kms_wish wish = {0};
	struct dio_kms_route route;
	uint32_t mode;

	outputs->connectors[0].current_crtc = 1;
	assert_true(dio_kms_choose(outputs, &wish, 0, &route, &mode));
	assert_int_equal(route.crtc, 1);
	outputs->connectors[0].current_crtc = 0;
	outputs->connectors[0].possible_crtcs = 2;
	assert_true(dio_kms_choose(outputs, &wish, 0, &route, &mode));
	assert_int_equal(route.crtc, 1);
	outputs->connectors[0].possible_crtcs = 4;
	assert_false(dio_kms_choose(outputs, &wish, 0, &route, &mode));
}

#define over_fake(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		over_fake(screen_comes_on_black_in_its_preferred_mode),
		over_fake(picture_is_on_the_screen_at_the_vertical_blank),
		over_fake(one_flip_is_in_flight_and_the_newest_picture_follows_it),
		over_fake(slots_go_round_without_tearing),
		over_fake(busy_card_is_tried_again),
		over_fake(unplugged_screen_is_a_state_and_plugging_in_recovers),
		over_fake(flip_of_before_the_unplugging_is_nobodys),
		over_fake(display_without_screen_opens_off_and_comes_on_later),
		over_fake(plug_news_about_the_same_screen_disturbs_nothing),
		over_fake(another_screen_gets_its_own_mode),
		over_fake(flip_that_never_comes_starts_the_screen_again),
		over_fake(screen_taken_by_another_program_is_away_until_it_can_be_reclaimed),
		over_fake(terminal_is_given_up_and_taken_back),
		over_fake(screen_gone_while_away_is_off_on_return),
		over_fake(closing_puts_back_what_was_shown_before_buffers_go),
		over_fake(card_that_is_removed_is_told),
		over_fake(mode_that_the_card_refuses_is_passed_over),
		over_fake(card_that_refuses_every_mode_is_told),
		over_fake(memory_that_runs_out_at_any_slot_is_given_back),
		over_fake(card_with_a_screen_goes_before_one_without),
		over_fake(card_that_only_computes_is_passed_over),
		over_fake(cards_that_cannot_be_used_are_told_apart),
		over_fake(connector_that_is_wished_is_the_only_one_used),
		over_fake(wished_mode_is_taken_where_the_screen_has_it),
		over_fake(crtc_in_use_is_kept_and_one_that_cannot_is_not),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
