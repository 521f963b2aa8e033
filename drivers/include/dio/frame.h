/* A frame: one picture as a camera delivered it. The first arrow of the data's way. */
#ifndef DIO_FRAME_H
#define DIO_FRAME_H

#include <stddef.h>
#include <stdint.h>

#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum dio_pixel_format {
	DIO_PIXEL_RGB24, /* [h][w][3] bytes */
	DIO_PIXEL_GRAY8, /* [h][w] bytes */
	DIO_PIXEL_YUYV,  /* [h][w/2][4] bytes Y0 U Y1 V; BT.601 limited range unless the driver says
			    otherwise */
	DIO_PIXEL_NV12,  /* [h][w] Y, then [h/2][w/2][2] UV */
	DIO_PIXEL_MJPEG, /* one JPEG picture of size_bytes */
};

/** What of a camera is held still, in dio_frame_metadata.locked. */
enum dio_camera_lock {
	DIO_LOCK_EXPOSURE = 1,
	DIO_LOCK_GAIN = 2,
	DIO_LOCK_WHITE_BALANCE = 4,
	DIO_LOCK_FOCUS = 8,
};

/** How the camera took a frame, as far as it says; 0 where it does not. */
struct dio_frame_metadata {
	uint32_t exposure_us;
	float gain;                /* the device's unit; libcamera: times */
	uint32_t white_balance_k;  /* colour temperature */
	float red_gain, blue_gain; /* relative to green */
	uint32_t locked;           /* enum dio_camera_lock bits that the driver confirmed */
};

/**
 * One frame. Who made it owns `data`; a driver's frame is valid until the next call that takes one.
 *
 * width, height   pixels
 * pitch_bytes     from one row to the next; 0 for MJPEG
 * timestamp_ns    CLOCK_MONOTONIC of the exposure as the driver states it
 * sequence        the driver's counter; a gap means frames lost
 */
struct dio_frame {
	enum dio_pixel_format format;
	uint32_t width, height, pitch_bytes;
	uint64_t timestamp_ns;
	uint64_t sequence;
	const uint8_t *data;
	size_t size_bytes;
	struct dio_frame_metadata metadata;
};

/** A picture in memory of its own: RGB, 8 bits, rows without padding. */
struct dio_picture {
	uint32_t width, height;
	uint8_t *rgb; /* [height][width][3]; owned */
};

/** Allocate width x height; release with dio_picture_deinit(). DIO_NO_MEM, DIO_BAD_ARG (0 or >
 * 16384). */
enum dio_status dio_picture_init(struct dio_picture *picture, uint32_t width, uint32_t height);
void dio_picture_deinit(struct dio_picture *picture);

/** "RGB24", "YUYV" and so on, for messages. */
const char *dio_pixel_format_name(enum dio_pixel_format format);

/**
 * Convert a frame of any format to RGB. `picture` is zero-initialised or a picture from an earlier
 * call; its memory is reused when the size is the same (so a loop allocates once).
 *
 * DIO_BAD_ARG   pitch or size too small for the format
 * DIO_BAD_FILE  a JPEG that does not decode
 */
enum dio_status dio_frame_to_rgb(const struct dio_frame *frame, struct dio_picture *picture,
				 struct dio_error *error);

/** View a picture as a frame (borrowed). */
struct dio_frame dio_frame_from_picture(const struct dio_picture *picture);

/**
 * Read a PNG or JPEG file (by content, not by name) as RGB; 16-bit and palette are converted, alpha
 * is laid over white. EXIF orientation is not applied: calibration and poses speak of stored
 * pixels. A truncated or damaged file is refused, never filled up with grey.
 *
 * picture  receives a new picture; what it held before is not released
 */
enum dio_status dio_picture_read(const char *path, struct dio_picture *picture,
				 struct dio_error *error);

/** Decode PNG or JPEG bytes; `name` is for messages. */
enum dio_status dio_picture_decode(const uint8_t *bytes, size_t size, const char *name,
				   struct dio_picture *picture, struct dio_error *error);

/**
 * Encode as PNG or JPEG by the ending of `name`, as dio_picture_write() does.
 *
 * bytes  receives the memory; release with free()
 */
enum dio_status dio_picture_encode(const char *name, const struct dio_picture *picture,
				   uint8_t **bytes, size_t *size, struct dio_error *error);

/** Write beside, sync, rename. PNG by the name's ending ".png", JPEG quality 95 by ".jpg"/".jpeg".
 */
enum dio_status dio_picture_write(const char *path, const struct dio_picture *picture,
				  struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
