/* The window on SDL's dummy display: what is sent as events must come out as input. */
#include "check.h"

#include <SDL.h>
#include <stdlib.h>
#include <string.h>

#include "dio/window.h"

static int open_window(void **state)
{
	struct dio_window *window;
	struct dio_error error;

	setenv("SDL_VIDEODRIVER", "dummy", 1);
	if (dio_window_open("test", 100, 50, &window, &error) != DIO_OK) {
		print_error("%s\n", error.text);
		return -1;
	}
	*state = window;
	return 0;
}

static int close_window(void **state)
{
	dio_window_close(*state);
	return 0;
}

static void push_key(SDL_Keycode key, bool down)
{
	SDL_Event event = {.key = {.type = down ? SDL_KEYDOWN : SDL_KEYUP, .keysym = {.sym = key}}};

	assert_int_equal(SDL_PushEvent(&event), 1);
}

static void push_motion(uint32_t buttons, int x, int y)
{
	SDL_Event event = {
		.motion = {.type = SDL_MOUSEMOTION, .state = buttons, .xrel = x, .yrel = y}};

	assert_int_equal(SDL_PushEvent(&event), 1);
}

static struct dio_window_input poll_input(void **state)
{
	struct dio_window_input input;

	dio_window_poll(*state, 1, &input);
	return input;
}

static void pictures_of_any_size_are_shown(void **state)
{
	struct dio_picture picture = {0};
	struct dio_error error;

	assert_fails(dio_window_show(*state, &picture, &error), DIO_BAD_ARG, error, "no picture");
	for (uint32_t side = 1; side < 400; side += 133) {
		assert_int_equal(dio_picture_init(&picture, side, 2 * side), DIO_OK);
		assert_ok(dio_window_show(*state, &picture, &error), error);
		assert_ok(dio_window_show(*state, &picture, &error), error);
		dio_picture_deinit(&picture);
	}
}

static void drags_are_shares_of_the_window(void **state)
{
	struct dio_window_input input;

	poll_input(state);
	push_motion(SDL_BUTTON_LMASK, 10, 10);
	push_motion(SDL_BUTTON_LMASK, 10, -5);
	push_motion(SDL_BUTTON_RMASK, 50, 0);
	push_motion(0, 30, 30);
	input = poll_input(state);
	assert_float_equal(input.drag_x, 0.2, 1e-6);
	assert_float_equal(input.drag_y, 0.1, 1e-6);
	assert_float_equal(input.pan_x, 0.5, 1e-6);
	assert_float_equal(input.pan_y, 0, 1e-6);
}

static void keys_held_and_touched_count_once(void **state)
{
	struct dio_window_input input;

	poll_input(state);
	push_key(SDLK_RIGHT, true);
	push_key(SDLK_DOWN, true);
	push_key(SDLK_DOWN, false); /* touched between two polls */
	push_key(SDLK_PLUS, true);
	input = poll_input(state);
	assert_float_equal(input.key_x, 1, 0);
	assert_float_equal(input.key_y, -1, 0);
	assert_float_equal(input.key_zoom, 1, 0);
	input = poll_input(state);
	assert_float_equal(input.key_x, 1, 0);
	assert_float_equal(input.key_y, 0, 0);
	push_key(SDLK_RIGHT, false);
	push_key(SDLK_PLUS, false);
	input = poll_input(state);
	assert_float_equal(input.key_x, 0, 0);
	assert_float_equal(input.key_zoom, 0, 0);
}

static void commands_come_once(void **state)
{
	SDL_Event wheel = {.wheel = {.type = SDL_MOUSEWHEEL, .y = 2}};
	SDL_Event quit = {.type = SDL_QUIT};
	struct dio_window_input input;

	poll_input(state);
	push_key(SDLK_r, true);
	push_key(SDLK_s, true);
	SDL_PushEvent(&wheel);
	input = poll_input(state);
	assert_true(input.reset && input.save && !input.quit);
	assert_float_equal(input.wheel, 2, 0);
	input = poll_input(state);
	assert_false(input.reset || input.save || input.quit);
	push_key(SDLK_ESCAPE, true);
	assert_true(poll_input(state).quit);
	SDL_PushEvent(&quit);
	assert_true(poll_input(state).quit);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(pictures_of_any_size_are_shown, open_window,
						close_window),
		cmocka_unit_test_setup_teardown(drags_are_shares_of_the_window, open_window,
						close_window),
		cmocka_unit_test_setup_teardown(keys_held_and_touched_count_once, open_window,
						close_window),
		cmocka_unit_test_setup_teardown(commands_come_once, open_window, close_window),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
