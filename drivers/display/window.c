#include "dio/window.h"

#include <SDL.h>
#include <stdlib.h>
#include <string.h>

#include "window_key.h"

struct dio_window {
	SDL_Window *window;
	SDL_Renderer *renderer;
	SDL_Texture *texture;
	uint32_t width, height; /* of the texture */
	bool has_video;
	int right, left, up, down, plus, minus; /* keys held */
};

static enum dio_status fail_sdl(const char *what, struct dio_error *error)
{
	return dio_fail(
		error, DIO_UNSUPPORTED,
		"window: cannot %s: %s; run it where a display is (DISPLAY or WAYLAND_DISPLAY "
		"set), or write pictures to files",
		what, SDL_GetError());
}

void dio_window_close(struct dio_window *window)
{
	if (!window)
		return;
	if (window->texture)
		SDL_DestroyTexture(window->texture);
	if (window->renderer)
		SDL_DestroyRenderer(window->renderer);
	if (window->window)
		SDL_DestroyWindow(window->window);
	if (window->has_video)
		SDL_QuitSubSystem(SDL_INIT_VIDEO);
	free(window);
}

/* Without a display SDL falls back to drawing nowhere; only who asks for that by name gets it. */
static bool draws_nowhere(void)
{
	const char *driver = SDL_GetCurrentVideoDriver();
	const char *asked = getenv("SDL_VIDEODRIVER");

	return !driver || ((strcmp(driver, "offscreen") == 0 || strcmp(driver, "dummy") == 0 ||
			    strcmp(driver, "evdev") == 0) &&
			   (!asked || !asked[0]));
}

static enum dio_status set_up(struct dio_window *window, const char *title, uint32_t width,
			      uint32_t height, struct dio_error *error)
{
	/* Ctrl-C stays the program's own. */
	SDL_SetHint(SDL_HINT_NO_SIGNAL_HANDLERS, "1");
	SDL_SetHint(SDL_HINT_RENDER_SCALE_QUALITY, "linear");
	SDL_SetMainReady();
	if (SDL_InitSubSystem(SDL_INIT_VIDEO) != 0)
		return fail_sdl("open the display", error);
	window->has_video = true;
	if (draws_nowhere()) {
		SDL_SetError("no display is present");
		return fail_sdl("open the display", error);
	}
	window->window = SDL_CreateWindow(title, SDL_WINDOWPOS_CENTERED, SDL_WINDOWPOS_CENTERED,
					  (int)width, (int)height, SDL_WINDOW_RESIZABLE);
	if (!window->window)
		return fail_sdl("open a window", error);
	window->renderer = SDL_CreateRenderer(window->window, -1, 0);
	if (!window->renderer)
		window->renderer = SDL_CreateRenderer(window->window, -1, SDL_RENDERER_SOFTWARE);
	if (!window->renderer)
		return fail_sdl("draw into a window", error);
	return DIO_OK;
}

enum dio_status dio_window_open(const char *title, uint32_t width, uint32_t height,
				struct dio_window **window, struct dio_error *error)
{
	struct dio_window *made;
	enum dio_status status;

	if (width == 0 || height == 0 || width > 16384 || height > 16384)
		return dio_fail(error, DIO_BAD_ARG, "window: %ux%u; sides are 1 to 16384", width,
				height);
	made = calloc(1, sizeof(*made));
	if (!made)
		return dio_fail(error, DIO_NO_MEM, "window: out of memory");
	status = set_up(made, title, width, height, error);
	if (status != DIO_OK) {
		dio_window_close(made);
		return status;
	}
	*window = made;
	return DIO_OK;
}

/* The texture follows the picture's size; the window keeps its own. */
static enum dio_status fit_texture(struct dio_window *window, const struct dio_picture *picture,
				   struct dio_error *error)
{
	SDL_Texture *texture;

	if (window->texture && window->width == picture->width && window->height == picture->height)
		return DIO_OK;
	texture = SDL_CreateTexture(window->renderer, SDL_PIXELFORMAT_RGB24,
				    SDL_TEXTUREACCESS_STREAMING, (int)picture->width,
				    (int)picture->height);
	if (!texture)
		return fail_sdl("show a picture of this size", error);
	if (window->texture)
		SDL_DestroyTexture(window->texture);
	window->texture = texture;
	window->width = picture->width;
	window->height = picture->height;
	return DIO_OK;
}

/* As large as fits with its proportions kept. */
static SDL_Rect letterbox(const struct dio_window *window)
{
	int w = 0, h = 0;
	double scale;
	SDL_Rect rect;

	SDL_GetRendererOutputSize(window->renderer, &w, &h);
	scale = SDL_min((double)w / window->width, (double)h / window->height);
	rect.w = (int)(window->width * scale + 0.5);
	rect.h = (int)(window->height * scale + 0.5);
	rect.x = (w - rect.w) / 2;
	rect.y = (h - rect.h) / 2;
	return rect;
}

enum dio_status dio_window_show(struct dio_window *window, const struct dio_picture *picture,
				struct dio_error *error)
{
	enum dio_status status;
	SDL_Rect rect;

	if (!picture->rgb)
		return dio_fail(error, DIO_BAD_ARG, "window: no picture to show");
	status = fit_texture(window, picture, error);
	if (status != DIO_OK)
		return status;
	rect = letterbox(window);
	if (SDL_UpdateTexture(window->texture, NULL, picture->rgb, (int)(3 * picture->width)) !=
		    0 ||
	    SDL_SetRenderDrawColor(window->renderer, 0, 0, 0, 255) != 0 ||
	    SDL_RenderClear(window->renderer) != 0 ||
	    SDL_RenderCopy(window->renderer, window->texture, NULL, &rect) != 0)
		return fail_sdl("draw", error);
	SDL_RenderPresent(window->renderer);
	return DIO_OK;
}

static void take_key(struct dio_window *window, SDL_Keycode key, bool down,
		     struct dio_window_input *input)
{
	const int held = down;

	switch (key) {
	case SDLK_RIGHT:
		window->right = held;
		input->key_x += (float)held;
		break;
	case SDLK_LEFT:
		window->left = held;
		input->key_x -= (float)held;
		break;
	case SDLK_UP:
		window->up = held;
		input->key_y += (float)held;
		break;
	case SDLK_DOWN:
		window->down = held;
		input->key_y -= (float)held;
		break;
	case SDLK_PLUS:
	case SDLK_EQUALS:
	case SDLK_KP_PLUS:
		window->plus = held;
		input->key_zoom += (float)held;
		break;
	case SDLK_MINUS:
	case SDLK_KP_MINUS:
		window->minus = held;
		input->key_zoom -= (float)held;
		break;
	case SDLK_ESCAPE:
	case SDLK_q:
		input->quit |= down;
		break;
	case SDLK_r:
		input->reset |= down;
		break;
	case SDLK_s:
		input->save |= down;
		break;
	default:
		break;
	}
}

static void list_key(SDL_Scancode scancode, bool down, struct dio_window_input *input)
{
	const struct dio_window_key key = {.key = dio_window_key(scancode), .pressed = down};

	if (key.key && input->key_count < DIO_WINDOW_KEYS_MAX)
		input->keys[input->key_count++] = key;
}

static void take_motion(const struct dio_window *window, const SDL_MouseMotionEvent *motion,
			struct dio_window_input *input)
{
	int w = 1, h = 1;
	float x, y;

	SDL_GetWindowSize(window->window, &w, &h);
	x = (float)motion->xrel / (float)SDL_max(w, 1);
	y = (float)motion->yrel / (float)SDL_max(h, 1);
	if (motion->state & SDL_BUTTON_LMASK) {
		input->drag_x += x;
		input->drag_y += y;
	} else if (motion->state & SDL_BUTTON_RMASK) {
		input->pan_x += x;
		input->pan_y += y;
	}
}

static void take_event(struct dio_window *window, const SDL_Event *event,
		       struct dio_window_input *input)
{
	switch (event->type) {
	case SDL_QUIT:
		input->quit = true;
		break;
	case SDL_KEYDOWN:
		/* Repeats are the held key once more; it is counted as held anyway. */
		if (event->key.repeat)
			break;
		take_key(window, event->key.keysym.sym, true, input);
		list_key(event->key.keysym.scancode, true, input);
		break;
	case SDL_KEYUP:
		take_key(window, event->key.keysym.sym, false, input);
		list_key(event->key.keysym.scancode, false, input);
		break;
	case SDL_MOUSEMOTION:
		take_motion(window, &event->motion, input);
		break;
	case SDL_MOUSEWHEEL:
		input->wheel +=
			(float)(event->wheel.direction == SDL_MOUSEWHEEL_FLIPPED ? -event->wheel.y
										 : event->wheel.y);
		break;
	case SDL_WINDOWEVENT:
		if (event->window.event == SDL_WINDOWEVENT_CLOSE)
			input->quit = true;
		/* Keys let go while another window has the focus are never reported. */
		if (event->window.event == SDL_WINDOWEVENT_FOCUS_LOST)
			window->right = window->left = window->up = window->down = window->plus =
				window->minus = 0;
		break;
	default:
		break;
	}
}

/* A key counts once when it was touched and once when it is held, never more than 1. */
static float clamp_key(float touched, int held)
{
	float sum = touched + (float)held;

	return sum > 1 ? 1 : (sum < -1 ? -1 : sum);
}

void dio_window_poll(struct dio_window *window, uint32_t timeout_ms, struct dio_window_input *input)
{
	struct dio_window_input gathered = {0};
	SDL_Event event;
	int more =
		SDL_WaitEventTimeout(&event, timeout_ms > INT32_MAX ? INT32_MAX : (int)timeout_ms);

	for (; more; more = SDL_PollEvent(&event))
		take_event(window, &event, &gathered);
	gathered.key_x = clamp_key(gathered.key_x, window->right - window->left);
	gathered.key_y = clamp_key(gathered.key_y, window->up - window->down);
	gathered.key_zoom = clamp_key(gathered.key_zoom, window->plus - window->minus);
	*input = gathered;
}
