/* Raw pixel formats to RGB, one picture at a time. */
#ifndef DIO_BASE_PIXELS_H
#define DIO_BASE_PIXELS_H

#include "dio/frame.h"

/**
 * Convert a frame of any format but MJPEG to packed RGB.
 *
 * YCbCr is BT.601 limited range (Y 16..235, Cb and Cr 16..240), as UVC cameras and V4L2's
 * SMPTE170M default deliver it, computed in 16-bit fixed point and rounded to nearest; each chroma
 * sample is used for the pixels it covers, without interpolation.
 *
 * frame  already checked by dio_pixels_check()
 * rgb    [height][width][3]
 */
void dio_pixels_to_rgb(const struct dio_frame *frame, uint8_t *rgb);

/** Bytes in a row and in all that a frame of this format must have; DIO_BAD_ARG when it has not. */
enum dio_status dio_pixels_check(const struct dio_frame *frame, struct dio_error *error);

#endif
