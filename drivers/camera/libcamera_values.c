#include "libcamera_values.h"

#include <math.h>

#define FOURCC(a, b, c, d)                                                                         \
	((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)
#define RECENT_NS  10000000000ull
#define NEAR_SHARE 0.05

bool dio_libcamera_format(uint32_t fourcc, enum dio_pixel_format *format, uint32_t *rank)
{
	static const struct {
		uint32_t fourcc;
		enum dio_pixel_format format;
	} known[] = {
		{FOURCC('Y', 'U', 'Y', 'V'), DIO_PIXEL_YUYV},
		{FOURCC('N', 'V', '1', '2'), DIO_PIXEL_NV12},
		{FOURCC('B', 'G', '2', '4'), DIO_PIXEL_RGB24},
		{FOURCC('R', '8', ' ', ' '), DIO_PIXEL_GRAY8},
		{FOURCC('M', 'J', 'P', 'G'), DIO_PIXEL_MJPEG},
	};

	for (uint32_t i = 0; i < sizeof(known) / sizeof(known[0]); i++) {
		if (known[i].fourcc != fourcc)
			continue;
		*format = known[i].format;
		*rank = i;
		return true;
	}
	return false;
}

size_t dio_libcamera_frame_bytes(enum dio_pixel_format format, uint32_t pitch_bytes, uint32_t width,
				 uint32_t height)
{
	static const uint32_t pixel_bytes[] = {
		[DIO_PIXEL_RGB24] = 3,
		[DIO_PIXEL_GRAY8] = 1,
		[DIO_PIXEL_YUYV] = 2,
		[DIO_PIXEL_NV12] = 1,
	};
	size_t rows = height;

	if (format == DIO_PIXEL_MJPEG)
		return 1;
	if (width == 0 || height == 0 || width > 16384 || height > 16384 ||
	    pitch_bytes < width * pixel_bytes[format] || pitch_bytes > (1u << 20))
		return 0;
	if (format == DIO_PIXEL_NV12)
		rows += (rows + 1) / 2;
	return (size_t)pitch_bytes * (rows - 1) + (size_t)width * pixel_bytes[format];
}

static bool is_recent(uint64_t time_ns, uint64_t now_ns)
{
	return time_ns > 0 && time_ns <= now_ns && now_ns - time_ns < RECENT_NS;
}

uint64_t dio_libcamera_time(uint64_t sensor_ns, uint64_t buffer_ns, uint64_t now_ns,
			    uint64_t boottime_minus_monotonic_ns)
{
	if (is_recent(sensor_ns, now_ns))
		return sensor_ns;
	if (sensor_ns > boottime_minus_monotonic_ns &&
	    is_recent(sensor_ns - boottime_minus_monotonic_ns, now_ns))
		return sensor_ns - boottime_minus_monotonic_ns;
	return is_recent(buffer_ns, now_ns) ? buffer_ns : now_ns;
}

bool dio_libcamera_is_near(double set, double read)
{
	return fabs(set - read) <= NEAR_SHARE * fabs(set);
}

int32_t dio_libcamera_flicker_period_us(enum dio_camera_flicker flicker)
{
	switch (flicker) {
	case DIO_CAMERA_FLICKER_50HZ:
		return 10000;
	case DIO_CAMERA_FLICKER_60HZ:
		return 8333;
	default:
		return 0;
	}
}
