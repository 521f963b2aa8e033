/* The window of a build without SDL2: there is none. */
#include "dio/window.h"

enum dio_status dio_window_open(const char *title, uint32_t width, uint32_t height,
				struct dio_window **window, struct dio_error *error)
{
	(void)title;
	(void)width;
	(void)height;
	(void)window;
	return dio_fail(
		error, DIO_UNSUPPORTED,
		"window: this build has no SDL2; install libsdl2-dev and build again, or write "
		"pictures to files");
}

enum dio_status dio_window_show(struct dio_window *window, const struct dio_picture *picture,
				struct dio_error *error)
{
	(void)window;
	(void)picture;
	return dio_fail(error, DIO_UNSUPPORTED, "window: this build has no SDL2");
}

void dio_window_poll(struct dio_window *window, uint32_t timeout_ms, struct dio_window_input *input)
{
	(void)window;
	(void)timeout_ms;
	*input = (struct dio_window_input){.quit = true};
}

void dio_window_close(struct dio_window *window)
{
	(void)window;
}
