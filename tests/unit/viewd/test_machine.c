/* The state machine: every state met with every event and action. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "viewd/machine.h"

#define ACTIONS (DIO_ACTION_SHUTDOWN + 1)
#define FACTS   10 /* yes-or-no facts */

/* A box on which everything is in order. */
static const struct dio_viewd_facts READY = {
	.board_known = true,
	.calibrated = true,
	.engine_ready = true,
	.camera_streaming = true,
	.pose_known = true,
	.scene_there = true,
	.space_for_views = true,
	.space_for_scene = true,
	.gathered = 20,
	.views = 8,
	.views_min = 4,
};

static enum dio_status step(struct dio_viewd_machine *machine, enum dio_viewd_event_kind kind,
			    enum dio_action action, const struct dio_viewd_facts *facts,
			    uint32_t *orders, struct dio_error *why)
{
	const struct dio_viewd_event event = {.kind = kind, .action = action};

	*orders = 0xdead;
	why->text[0] = '\0';
	return dio_viewd_machine_step(machine, &event, facts, orders, why);
}

/* Ask in a state, on a box in order but for what `facts` says. */
static void expect_asked(enum dio_viewd_state from, enum dio_action action,
			 const struct dio_viewd_facts *facts, enum dio_status status,
			 enum dio_viewd_state to, uint32_t orders)
{
	struct dio_viewd_machine machine = {.state = from};
	struct dio_error why;
	uint32_t given;
	enum dio_status got = step(&machine, DIO_VIEWD_ASKED, action, facts, &given, &why);

	if (got != status || machine.state != to || given != orders)
		fail_msg("%s in %s: status %d, state %s, orders %x: %s", dio_action_name(action),
			 dio_viewd_state_name(from), (int)got, dio_viewd_state_name(machine.state),
			 given, why.text);
	assert_int_equal(machine.failed, status != DIO_OK);
}

static void expect_told(enum dio_viewd_state from, enum dio_viewd_event_kind kind,
			enum dio_viewd_state to, uint32_t orders)
{
	struct dio_viewd_machine machine = {.state = from, .fitting = kind == DIO_VIEWD_FITTED};
	struct dio_error why;
	uint32_t given;

	assert_int_equal(step(&machine, kind, DIO_ACTION_NONE, &READY, &given, &why), DIO_OK);
	if (machine.state != to || given != orders)
		fail_msg("event %d in %s: state %s, orders %x", (int)kind,
			 dio_viewd_state_name(from), dio_viewd_state_name(machine.state), given);
}

/* What every state makes of every action, on a box in order: the whole table. */
static void every_action_in_every_state_does_what_the_table_says(void **state)
{
	enum { IDLE, CALIBRATE, CAPTURE, RECONSTRUCT, VIEW, PLAY, STAY = -1 };
	static const struct {
		enum dio_action action;
		struct {
			int to; /* STAY: refused */
			uint32_t orders;
		} in[DIO_VIEWD_STATE_COUNT];
	} TABLE[] = {
		{DIO_ACTION_NONE,
		 {{IDLE, 0}, {CALIBRATE, 0}, {CAPTURE, 0}, {RECONSTRUCT, 0}, {VIEW, 0}, {PLAY, 0}}},
		{DIO_ACTION_CALIBRATE,
		 {{CALIBRATE, DIO_VIEWD_BEGIN_GATHER},
		  {CALIBRATE, DIO_VIEWD_FIT},
		  {CALIBRATE, DIO_VIEWD_BEGIN_GATHER},
		  {STAY, 0},
		  {CALIBRATE, DIO_VIEWD_BEGIN_GATHER},
		  {CALIBRATE, DIO_VIEWD_BEGIN_GATHER}}},
		{DIO_ACTION_CAPTURE,
		 {{CAPTURE, 0},
		  {STAY, 0},
		  {CAPTURE, DIO_VIEWD_TAKE_VIEW},
		  {STAY, 0},
		  {CAPTURE, 0},
		  {CAPTURE, 0}}},
		{DIO_ACTION_RECONSTRUCT,
		 {{RECONSTRUCT, DIO_VIEWD_RECONSTRUCT_NOW},
		  {STAY, 0},
		  {RECONSTRUCT, DIO_VIEWD_RECONSTRUCT_NOW},
		  {STAY, 0},
		  {RECONSTRUCT, DIO_VIEWD_RECONSTRUCT_NOW},
		  {RECONSTRUCT, DIO_VIEWD_RECONSTRUCT_NOW}}},
		{DIO_ACTION_PLAY,
		 {{PLAY, 0}, {STAY, 0}, {STAY, 0}, {STAY, 0}, {PLAY, 0}, {VIEW, 0}}},
		{DIO_ACTION_SAVE,
		 {{IDLE, DIO_VIEWD_SAVE_NOW},
		  {CALIBRATE, DIO_VIEWD_SAVE_NOW},
		  {CAPTURE, DIO_VIEWD_SAVE_NOW},
		  {STAY, 0},
		  {VIEW, DIO_VIEWD_SAVE_NOW},
		  {PLAY, DIO_VIEWD_SAVE_NOW}}},
		{DIO_ACTION_CANCEL,
		 {{IDLE, 0},
		  {IDLE, 0},
		  {IDLE, 0},
		  {RECONSTRUCT, DIO_VIEWD_CANCEL_ENGINE},
		  {IDLE, 0},
		  {VIEW, 0}}},
		{DIO_ACTION_SHUTDOWN,
		 {{IDLE, DIO_VIEWD_QUIT},
		  {CALIBRATE, DIO_VIEWD_QUIT},
		  {CAPTURE, DIO_VIEWD_QUIT},
		  {RECONSTRUCT, DIO_VIEWD_QUIT | DIO_VIEWD_CANCEL_ENGINE},
		  {VIEW, DIO_VIEWD_QUIT},
		  {PLAY, DIO_VIEWD_QUIT}}},
	};

	(void)state;
	assert_int_equal(sizeof TABLE / sizeof *TABLE, ACTIONS);
	for (size_t row = 0; row < ACTIONS; row++)
		for (int from = 0; from < DIO_VIEWD_STATE_COUNT; from++) {
			bool stays = TABLE[row].in[from].to == STAY;
			enum dio_status status = !stays                ? DIO_OK
						 : from == RECONSTRUCT ? DIO_BUSY
								       : DIO_REFUSED;

			expect_asked((enum dio_viewd_state)from, TABLE[row].action, &READY, status,
				     (enum dio_viewd_state)(stays ? from : TABLE[row].in[from].to),
				     TABLE[row].in[from].orders);
		}
}

static void a_model_that_is_being_opened_is_not_called_missing(void **state)
{
	struct dio_viewd_machine machine = {0};
	struct dio_viewd_facts facts = READY;
	struct dio_error why = {""};
	uint32_t orders;

	(void)state;
	facts.engine_ready = false;
	facts.engine_opening = true;
	assert_int_equal(
		step(&machine, DIO_VIEWD_ASKED, DIO_ACTION_RECONSTRUCT, &facts, &orders, &why),
		DIO_BUSY);
	assert_non_null(strstr(why.text, "being opened"));
	assert_int_equal(machine.state, DIO_VIEWD_IDLE);
	assert_int_equal(orders, 0);
}

static void what_is_missing_is_named(void **state)
{
	static const struct {
		enum dio_viewd_state from;
		enum dio_action action;
		size_t fact; /* offset of the flag that is not so */
		enum dio_status status;
		const char *word;
	} CASES[] = {
#define LACKS(field) offsetof(struct dio_viewd_facts, field)
		{DIO_VIEWD_IDLE, DIO_ACTION_CALIBRATE, LACKS(board_known), DIO_REFUSED, "board"},
		{DIO_VIEWD_IDLE, DIO_ACTION_CAPTURE, LACKS(board_known), DIO_REFUSED, "board"},
		{DIO_VIEWD_IDLE, DIO_ACTION_CAPTURE, LACKS(calibrated), DIO_REFUSED, "calibrate"},
		{DIO_VIEWD_VIEW, DIO_ACTION_CAPTURE, LACKS(space_for_views), DIO_NO_SPACE, "disk"},
		{DIO_VIEWD_CAPTURE, DIO_ACTION_CAPTURE, LACKS(space_for_views), DIO_NO_SPACE,
		 "disk"},
		{DIO_VIEWD_CAPTURE, DIO_ACTION_CAPTURE, LACKS(camera_streaming), DIO_REFUSED,
		 "camera"},
		{DIO_VIEWD_CAPTURE, DIO_ACTION_CAPTURE, LACKS(pose_known), DIO_REFUSED, "board"},
		{DIO_VIEWD_CAPTURE, DIO_ACTION_RECONSTRUCT, LACKS(engine_ready), DIO_REFUSED,
		 "model"},
		{DIO_VIEWD_CAPTURE, DIO_ACTION_RECONSTRUCT, LACKS(space_for_scene), DIO_NO_SPACE,
		 "disk"},
		{DIO_VIEWD_IDLE, DIO_ACTION_PLAY, LACKS(scene_there), DIO_REFUSED, "scene"},
		{DIO_VIEWD_VIEW, DIO_ACTION_SAVE, LACKS(space_for_scene), DIO_NO_SPACE, "disk"},
#undef LACKS
	};

	(void)state;
	for (size_t i = 0; i < sizeof CASES / sizeof *CASES; i++) {
		struct dio_viewd_machine machine = {.state = CASES[i].from};
		struct dio_viewd_facts facts = READY;
		struct dio_error why;
		uint32_t orders;

		*((bool *)((char *)&facts + CASES[i].fact)) = false;
		assert_int_equal(
			step(&machine, DIO_VIEWD_ASKED, CASES[i].action, &facts, &orders, &why),
			CASES[i].status);
		assert_int_equal(machine.state, CASES[i].from);
		assert_int_equal(orders, 0);
		if (!strstr(why.text, CASES[i].word))
			fail_msg("case %zu: \"%s\" is not in: %s", i, CASES[i].word, why.text);
	}
}

static void too_few_views_are_counted_in_the_refusal(void **state)
{
	struct dio_viewd_machine machine = {.state = DIO_VIEWD_CAPTURE};
	struct dio_viewd_facts facts = READY;
	struct dio_error why;
	uint32_t orders;

	(void)state;
	facts.views = 3;
	assert_int_equal(
		step(&machine, DIO_VIEWD_ASKED, DIO_ACTION_RECONSTRUCT, &facts, &orders, &why),
		DIO_REFUSED);
	assert_non_null(strstr(why.text, "3 views of at least 4"));
	facts.views = 0;
	assert_int_equal(step(&machine, DIO_VIEWD_ASKED, DIO_ACTION_SAVE, &facts, &orders, &why),
			 DIO_REFUSED);
	facts.gathered = 0;
	machine.state = DIO_VIEWD_CALIBRATE;
	assert_int_equal(
		step(&machine, DIO_VIEWD_ASKED, DIO_ACTION_CALIBRATE, &facts, &orders, &why),
		DIO_REFUSED);
	assert_non_null(strstr(why.text, "board"));
}

static void capture_begins_anew_only_when_the_views_have_their_scene(void **state)
{
	struct dio_viewd_facts facts = READY;

	(void)state;
	facts.views_closed = true;
	expect_asked(DIO_VIEWD_VIEW, DIO_ACTION_CAPTURE, &facts, DIO_OK, DIO_VIEWD_CAPTURE,
		     DIO_VIEWD_BEGIN_VIEWS);
	facts.views_closed = false;
	expect_asked(DIO_VIEWD_IDLE, DIO_ACTION_CAPTURE, &facts, DIO_OK, DIO_VIEWD_CAPTURE, 0);
	facts.views = 0;
	expect_asked(DIO_VIEWD_IDLE, DIO_ACTION_CAPTURE, &facts, DIO_OK, DIO_VIEWD_CAPTURE,
		     DIO_VIEWD_BEGIN_VIEWS);
}

static void news_move_the_state_that_waits_for_them_and_no_other(void **state)
{
	static const struct {
		enum dio_viewd_event_kind kind;
		enum dio_viewd_state from, to;
		uint32_t orders;
	} MOVES[] = {
		{DIO_VIEWD_STARTED, DIO_VIEWD_IDLE, DIO_VIEWD_VIEW, 0},
		{DIO_VIEWD_GATHERED, DIO_VIEWD_CALIBRATE, DIO_VIEWD_CALIBRATE, DIO_VIEWD_FIT},
		{DIO_VIEWD_FITTED, DIO_VIEWD_CALIBRATE, DIO_VIEWD_IDLE, 0},
		{DIO_VIEWD_VIEWS_FULL, DIO_VIEWD_CAPTURE, DIO_VIEWD_RECONSTRUCT,
		 DIO_VIEWD_RECONSTRUCT_NOW},
		{DIO_VIEWD_STORE_FAILED, DIO_VIEWD_CAPTURE, DIO_VIEWD_IDLE, 0},
		{DIO_VIEWD_RECONSTRUCTED, DIO_VIEWD_RECONSTRUCT, DIO_VIEWD_VIEW, 0},
		{DIO_VIEWD_CANCELLED, DIO_VIEWD_RECONSTRUCT, DIO_VIEWD_IDLE, 0},
		{DIO_VIEWD_ENGINE_FAILED, DIO_VIEWD_RECONSTRUCT, DIO_VIEWD_IDLE, 0},
		{DIO_VIEWD_ENGINE_FAILED, DIO_VIEWD_VIEW, DIO_VIEWD_IDLE, 0},
		{DIO_VIEWD_ENGINE_FAILED, DIO_VIEWD_PLAY, DIO_VIEWD_IDLE, 0},
	};

	(void)state;
	for (int kind = 0; kind < DIO_VIEWD_EVENT_COUNT; kind++)
		for (int from = 0; from < DIO_VIEWD_STATE_COUNT; from++) {
			enum dio_viewd_state to = (enum dio_viewd_state)from;
			uint32_t orders = 0;

			if (kind == DIO_VIEWD_ASKED)
				continue;
			for (size_t i = 0; i < sizeof MOVES / sizeof *MOVES; i++)
				if ((int)MOVES[i].kind == kind && (int)MOVES[i].from == from) {
					to = MOVES[i].to;
					orders = MOVES[i].orders;
				}
			expect_told((enum dio_viewd_state)from, (enum dio_viewd_event_kind)kind, to,
				    orders);
		}
}

static void a_start_takes_up_what_was_left(void **state)
{
	struct dio_viewd_facts facts = READY;
	struct dio_viewd_machine machine = {0};
	struct dio_error why;
	uint32_t orders;

	(void)state;
	facts.scene_there = false;
	step(&machine, DIO_VIEWD_STARTED, DIO_ACTION_NONE, &facts, &orders, &why);
	assert_int_equal(machine.state, DIO_VIEWD_IDLE);
	facts.reconstruct_due = true;
	step(&machine, DIO_VIEWD_STARTED, DIO_ACTION_NONE, &facts, &orders, &why);
	assert_int_equal(machine.state, DIO_VIEWD_RECONSTRUCT);
	assert_int_equal(orders, DIO_VIEWD_RECONSTRUCT_NOW);
	/* Without a model there is nothing to take it up with. */
	machine = (struct dio_viewd_machine){0};
	facts.engine_ready = false;
	step(&machine, DIO_VIEWD_STARTED, DIO_ACTION_NONE, &facts, &orders, &why);
	assert_int_equal(machine.state, DIO_VIEWD_IDLE);
}

static void a_fit_is_asked_for_once_and_again_after_a_refusal(void **state)
{
	struct dio_viewd_machine machine = {.state = DIO_VIEWD_CALIBRATE};
	struct dio_error why;
	uint32_t orders;

	(void)state;
	step(&machine, DIO_VIEWD_GATHERED, DIO_ACTION_NONE, &READY, &orders, &why);
	assert_int_equal(orders, DIO_VIEWD_FIT);
	step(&machine, DIO_VIEWD_GATHERED, DIO_ACTION_NONE, &READY, &orders, &why);
	assert_int_equal(orders, 0);
	assert_int_equal(
		step(&machine, DIO_VIEWD_ASKED, DIO_ACTION_CALIBRATE, &READY, &orders, &why),
		DIO_OK);
	assert_int_equal(orders, 0);
	step(&machine, DIO_VIEWD_FIT_REFUSED, DIO_ACTION_NONE, &READY, &orders, &why);
	assert_int_equal(machine.state, DIO_VIEWD_CALIBRATE);
	step(&machine, DIO_VIEWD_GATHERED, DIO_ACTION_NONE, &READY, &orders, &why);
	assert_int_equal(orders, DIO_VIEWD_FIT);
}

static void a_cancel_is_given_once_and_the_engine_ends_it(void **state)
{
	struct dio_viewd_machine machine = {.state = DIO_VIEWD_RECONSTRUCT};
	struct dio_error why;
	uint32_t orders;

	(void)state;
	step(&machine, DIO_VIEWD_ASKED, DIO_ACTION_CANCEL, &READY, &orders, &why);
	assert_int_equal(orders, DIO_VIEWD_CANCEL_ENGINE);
	assert_int_equal(machine.state, DIO_VIEWD_RECONSTRUCT);
	step(&machine, DIO_VIEWD_ASKED, DIO_ACTION_CANCEL, &READY, &orders, &why);
	assert_int_equal(orders, 0);
	/* It was done before it heard of it: then the scene is there. */
	step(&machine, DIO_VIEWD_RECONSTRUCTED, DIO_ACTION_NONE, &READY, &orders, &why);
	assert_int_equal(machine.state, DIO_VIEWD_VIEW);
	assert_false(machine.cancelling);
}

/* Every state, event, action and combination of facts: nothing leaves the bounds. */
static void no_combination_leaves_the_bounds(void **state)
{
	const uint32_t all = (DIO_VIEWD_QUIT << 1) - 1;

	(void)state;
	for (uint32_t bits = 0; bits < 1u << FACTS; bits++)
		for (int from = 0; from < DIO_VIEWD_STATE_COUNT; from++)
			for (int kind = 0; kind < DIO_VIEWD_EVENT_COUNT; kind++)
				for (int action = 0; action < ACTIONS; action++) {
					struct dio_viewd_machine machine = {
						.state = (enum dio_viewd_state)from};
					struct dio_viewd_facts facts = {
						.board_known = bits & 1,
						.calibrated = bits & 2,
						.engine_ready = bits & 4,
						.camera_streaming = bits & 8,
						.pose_known = bits & 16,
						.scene_there = bits & 32,
						.views_closed = bits & 64,
						.reconstruct_due = bits & 128,
						.space_for_views = bits & 256,
						.space_for_scene = bits & 512,
						.views = bits & 1 ? 8 : 0,
						.views_min = 4,
					};
					struct dio_error why;
					uint32_t orders;
					enum dio_status status = step(
						&machine, (enum dio_viewd_event_kind)kind,
						(enum dio_action)action, &facts, &orders, &why);

					assert_true((unsigned)machine.state <
						    DIO_VIEWD_STATE_COUNT);
					assert_int_equal(orders & ~all, 0);
					/* A refusal changes nothing and says why. */
					if (status != DIO_OK) {
						assert_int_equal(orders, 0);
						assert_int_equal(machine.state, from);
						assert_true(*why.text);
					}
					/* The engine never starts without what it needs. */
					if (orders & DIO_VIEWD_RECONSTRUCT_NOW)
						assert_true(facts.engine_ready &&
							    facts.space_for_scene &&
							    facts.views > 0);
					if (machine.state == DIO_VIEWD_CAPTURE &&
					    (enum dio_viewd_state)from != machine.state)
						assert_true(facts.calibrated &&
							    facts.space_for_views);
				}
}

static void leds_follow_the_state_and_show_failures(void **state)
{
	struct dio_viewd_machine machine = {.state = DIO_VIEWD_PLAY};

	(void)state;
	assert_int_equal(dio_viewd_machine_led(&machine), DIO_LED_STATE_VIEW);
	machine.state = DIO_VIEWD_CALIBRATE;
	assert_int_equal(dio_viewd_machine_led(&machine), DIO_LED_STATE_CALIBRATE);
	machine.failed = true;
	assert_int_equal(dio_viewd_machine_led(&machine), DIO_LED_STATE_ERROR);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_action_in_every_state_does_what_the_table_says),
		cmocka_unit_test(what_is_missing_is_named),
		cmocka_unit_test(a_model_that_is_being_opened_is_not_called_missing),
		cmocka_unit_test(too_few_views_are_counted_in_the_refusal),
		cmocka_unit_test(capture_begins_anew_only_when_the_views_have_their_scene),
		cmocka_unit_test(news_move_the_state_that_waits_for_them_and_no_other),
		cmocka_unit_test(a_start_takes_up_what_was_left),
		cmocka_unit_test(a_fit_is_asked_for_once_and_again_after_a_refusal),
		cmocka_unit_test(a_cancel_is_given_once_and_the_engine_ends_it),
		cmocka_unit_test(no_combination_leaves_the_bounds),
		cmocka_unit_test(leds_follow_the_state_and_show_failures),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
