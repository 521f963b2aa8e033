/* What a display backend provides; display.c calls it behind the public interface. */
#ifndef DIO_DISPLAY_BACKEND_H
#define DIO_DISPLAY_BACKEND_H

#include "dio/display.h"

#define DIO_DISPLAY_EVENTS_MAX 32
#define DIO_DISPLAY_WIDTH      1280
#define DIO_DISPLAY_HEIGHT     720
#define DIO_DISPLAY_HZ         30.0

/** One backend; the contract of show is that of dio_display_show(). */
struct dio_display_ops {
	enum dio_status (*show)(struct dio_display *display, const struct dio_picture *picture,
				uint64_t tag, struct dio_error *error);
	/** Take in what happened, without waiting; events go to dio_display_push(). */
	enum dio_status (*dispatch)(struct dio_display *display, struct dio_error *error);
	/** Releases the object itself too. */
	enum dio_status (*close)(struct dio_display *display, struct dio_error *error);
};

/** Embedded as the first member of each backend's own object. */
struct dio_display {
	const struct dio_display_ops *ops;
	struct dio_display_info info;
	struct dio_display_counters counters;
	int fd; /* readable when dispatch has work */
	struct dio_display_event events[DIO_DISPLAY_EVENTS_MAX];
	uint32_t first, event_count;
};

/** Queue an event; the oldest goes when nobody took them. */
void dio_display_push(struct dio_display *display, const struct dio_display_event *event);

/** State or size is another from now on. */
void dio_display_push_changed(struct dio_display *display, uint64_t time_ns);

/** A wished mode in parts; 0 where nothing was said. */
struct dio_display_mode {
	uint32_t width, height;
	double refresh_hz;
};

/** Read "1920x1080", "1920x1080@59.94" or nothing. DIO_BAD_ARG. */
enum dio_status dio_display_mode_parse(const char *text, struct dio_display_mode *mode,
				       struct dio_error *error);

/** `path` is what follows "file:", or NULL: none. */
enum dio_status dio_display_open_paced(const char *path, const struct dio_display_mode *mode,
				       const struct dio_display_options *options,
				       struct dio_display **display, struct dio_error *error);
enum dio_status dio_display_open_window(const struct dio_display_mode *mode,
					const struct dio_display_options *options,
					struct dio_display **display, struct dio_error *error);
/** `card` is what follows "kms:", or "". */
enum dio_status dio_display_open_kms(const char *card, const struct dio_display_mode *mode,
				     const struct dio_display_options *options,
				     struct dio_display **display, struct dio_error *error);

#endif
