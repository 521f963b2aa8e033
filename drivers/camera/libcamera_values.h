/* What libcamera's numbers mean in ours; apart from its library, so that tests need none. */
#ifndef DIO_CAMERA_LIBCAMERA_VALUES_H
#define DIO_CAMERA_LIBCAMERA_VALUES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/camera.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Our format for a DRM fourcc, which names colours from the high byte down: DRM's BGR888 is R, G, B
 * in memory (drm_fourcc.h).
 *
 * rank  receives the place in the order of preference, 0 the best
 */
bool dio_libcamera_format(uint32_t fourcc, enum dio_pixel_format *format, uint32_t *rank);

/** Bytes that a frame takes at least; 1 for MJPEG. 0: it would overflow. */
size_t dio_libcamera_frame_bytes(enum dio_pixel_format format, uint32_t pitch_bytes, uint32_t width,
				 uint32_t height);

/**
 * The time of a frame on CLOCK_MONOTONIC.
 *
 * SensorTimestamp is documented as CLOCK_BOOTTIME, and pipelines hand on the kernel's
 * CLOCK_MONOTONIC in it; the two differ by the time the machine has slept. So each is taken as it
 * is when it lies within ten seconds before now, and the sensor's, being nearer to the exposure,
 * goes first.
 *
 * sensor_ns, buffer_ns  0: not given
 */
uint64_t dio_libcamera_time(uint64_t sensor_ns, uint64_t buffer_ns, uint64_t now_ns,
			    uint64_t boottime_minus_monotonic_ns);

/** Whether a value that was read back is the one that was set: sensors count in lines and steps. */
bool dio_libcamera_is_near(double set, double read);

/** AeFlickerPeriod in microseconds, 0 for none: light swells twice a mains cycle. */
int32_t dio_libcamera_flicker_period_us(enum dio_camera_flicker flicker);

#ifdef __cplusplus
}
#endif
#endif
