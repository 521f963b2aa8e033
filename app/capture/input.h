/* Pictures from an INPUT of the command line: a folder, a recording or a camera. */
#ifndef DIO_CAPTURE_INPUT_H
#define DIO_CAPTURE_INPUT_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/camera.h"
#include "dio/frame.h"
#include "dio/status.h"

/** How pictures follow one another. */
enum dio_input_kind {
	DIO_INPUT_PHOTOS,    /* a folder: pictures somebody chose */
	DIO_INPUT_RECORDING, /* a stream that ends: neighbours look alike */
	DIO_INPUT_LIVE,      /* a camera: endless */
};

/** Opaque, thread-bound. */
struct dio_input;

/**
 * What a person before the camera would do, as words of the simulated one: `sim:table` becomes
 * `sim:table?style=dance&fps=2` with words "style=dance&fps=2". Words that `spec` has stay as they
 * are, and so does any other input. Release with free(); NULL: memory was short.
 */
char *dio_input_instruct(const char *spec, const char *words);

/** What is known of one picture beside its pixels. */
struct dio_input_frame {
	char name[256]; /* the file's name, or "frame 12" */
	uint64_t timestamp_ns;
	uint64_t index; /* counts the frames delivered, damaged ones included, from 0 */
};

/**
 * Open and start an input. Files are read as fast as wanted and none is left out.
 *
 * spec     see dio_camera_open()
 * options  NULL, or wishes about size and rate
 */
enum dio_status dio_input_open(const char *spec, const struct dio_camera_options *options,
			       struct dio_input **input, struct dio_error *error);
/** NULL is fine. */
void dio_input_close(struct dio_input *input);

enum dio_input_kind dio_input_get_kind(const struct dio_input *input);
/** The camera behind it, owned by the input: for its information and counters. */
const struct dio_camera *dio_input_get_camera(const struct dio_input *input);
/** Number of pictures to come, 0 when endless or unknown. */
uint64_t dio_input_get_length(const struct dio_input *input);
/** Pictures passed over because they could not be read, each named in a warning. */
uint32_t dio_input_get_unreadable(const struct dio_input *input);

/**
 * The next frame as the camera delivered it. A file that cannot be read is warned of by name and
 * passed over.
 *
 * frame  valid until the next call
 * about  NULL, or filled
 *
 * DIO_END        no more
 * DIO_NO_SIGNAL  the camera delivers nothing
 * DIO_GONE       unplugged: what came before stays good
 */
enum dio_status dio_input_next_frame(struct dio_input *input, struct dio_frame *frame,
				     struct dio_input_frame *about, struct dio_error *error);

/** The same as RGB; `picture` is zero-initialised or one of an earlier call. */
enum dio_status dio_input_next(struct dio_input *input, struct dio_picture *picture,
			       struct dio_input_frame *about, struct dio_error *error);

#endif
