/* The web page for a box without a display: preview, buttons, orbit by dragging, downloads. */
#ifndef DIO_WEB_WEB_H
#define DIO_WEB_WEB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/status.h"

/** What the page shows and steers. All of it is called from dio_web_dispatch(). */
struct dio_web_host {
	void *context;
	/** What there is to say as a JSON object; release with free(). NULL: memory is short. */
	char *(*describe)(void *context);
	/**
	 * A button: "calibrate", "capture", "reconstruct", "play", "save", "cancel", "follow"; or
	 * "turn" with azimuth, elevation (radians) and notches.
	 */
	enum dio_status (*act)(void *context, const char *word, const double numbers[3],
			       struct dio_error *error);
	/** The newest picture as JPEG, borrowed for the call; false: none yet. */
	bool (*get_picture)(void *context, const uint8_t **bytes, size_t *size);
	/** Folder with scene.json, scene.safetensors and images/, NULL: there is none. */
	const char *(*get_folder)(void *context);
};

struct dio_web_options {
	const char *address; /* numeric, IPv4 or IPv6 */
	uint16_t port;       /* 0: any that is free */
	const char *token;   /* what callers must know; at least 16 letters; copied */
	struct dio_web_host host;
};

/** Opaque, thread-bound. */
struct dio_web;

/**
 * Listen.
 *
 * DIO_BAD_ARG  an address that cannot be read, a token that is too short
 * DIO_BUSY     the port is taken; DIO_REFUSED  not permitted
 */
enum dio_status dio_web_open(const struct dio_web_options *options, struct dio_web **web,
			     struct dio_error *error);
/** NULL is fine. */
void dio_web_close(struct dio_web *web);

uint16_t dio_web_get_port(const struct dio_web *web);
/** Readable when dio_web_dispatch() has work; it wants to be called a few times a second besides,
 * for connections that time out. */
int dio_web_get_fd(const struct dio_web *web);
/** Never waits. */
void dio_web_dispatch(struct dio_web *web);

/**
 * The token of a file; a file that is missing is made, for its owner alone, with a new one.
 *
 * token   receives it; release with free()
 *
 * DIO_BAD_FILE  fewer than 16 letters, or letters that do not go into a header
 */
enum dio_status dio_web_read_token(const char *path, char **token, struct dio_error *error);

#define DIO_WEB_TOKEN_MIN 16u

#endif
