#include "captured/steady.h"

#include <math.h>

/* Pixels looked at a side: enough for a mean, little beside the conversion. */
#define GRID 64u
/* Of full scale, between the means of the older and the newer half of the samples; noise and small
 * movements stay below, a step of automatic exposure (a third of a stop) is above. */
#define LEVEL_DRIFT  0.01
#define COLOUR_DRIFT 0.02

void dio_steady_reset(struct dio_steady *steady)
{
	steady->count = 0;
	steady->last_ns = 0;
}

void dio_steady_deinit(struct dio_steady *steady)
{
	dio_picture_deinit(&steady->picture);
	*steady = (struct dio_steady){0};
}

static void measure(const struct dio_picture *picture, double *level, double *red, double *blue)
{
	const uint32_t step_x = picture->width > GRID ? picture->width / GRID : 1;
	const uint32_t step_y = picture->height > GRID ? picture->height / GRID : 1;
	double sum[3] = {0}, total;
	uint32_t n = 0;

	for (uint32_t y = 0; y < picture->height; y += step_y) {
		for (uint32_t x = 0; x < picture->width; x += step_x) {
			const uint8_t *pixel = picture->rgb + 3 * ((size_t)y * picture->width + x);

			for (size_t c = 0; c < 3; c++)
				sum[c] += pixel[c];
			n++;
		}
	}
	total = sum[0] + sum[1] + sum[2];
	*level = total / (3.0 * 255.0 * n);
	/* Of black one cannot tell the colour. */
	*red = total > 0 ? sum[0] / total : 1.0 / 3;
	*blue = total > 0 ? sum[2] / total : 1.0 / 3;
}

static bool is_at_rest(const struct dio_steady *steady)
{
	const uint32_t half = DIO_STEADY_SAMPLES / 2;
	double level = 0, red = 0, blue = 0;

	if (steady->count < DIO_STEADY_SAMPLES)
		return false;
	for (uint32_t i = 0; i < DIO_STEADY_SAMPLES; i++) {
		/* From the oldest on. */
		uint32_t at = (steady->count + i) % DIO_STEADY_SAMPLES;
		double sign = i < half ? -1.0 / half : 1.0 / half;

		level += sign * steady->samples[at].level;
		red += sign * steady->samples[at].red;
		blue += sign * steady->samples[at].blue;
	}
	return fabs(level) < LEVEL_DRIFT && fabs(red) < COLOUR_DRIFT && fabs(blue) < COLOUR_DRIFT;
}

bool dio_steady_look(struct dio_steady *steady, const struct dio_frame *frame)
{
	uint32_t at = steady->count % DIO_STEADY_SAMPLES;

	if (steady->count > 0 && frame->timestamp_ns < steady->last_ns + DIO_STEADY_PERIOD_NS)
		return false;
	if (dio_frame_to_rgb(frame, &steady->picture, NULL) != DIO_OK)
		return false;
	measure(&steady->picture, &steady->samples[at].level, &steady->samples[at].red,
		&steady->samples[at].blue);
	steady->last_ns = frame->timestamp_ns;
	steady->count++;
	return is_at_rest(steady);
}
