/* What a sensor does to one value or one pixel. */
#ifndef DIO_SIM_DEVELOP_H
#define DIO_SIM_DEVELOP_H

#include "dio/sim.h"
#include "rng.h"

enum { BLUR_REACH = 12 };

struct blur {
	int32_t reach; /* 0: none */
	float weight[2 * BLUR_REACH + 1];
};

/* A bell from repeated squares is close to a Gaussian and needs no exp(). */
DIO_SIM_FN struct blur blur_of(float sigma)
{
	struct blur b = {0};
	float sum = 0;

	b.weight[0] = 1;
	if (sigma <= 0.05f)
		return b;
	b.reach = floor_int(3 * sigma) + 1;
	b.reach = b.reach > BLUR_REACH ? BLUR_REACH : b.reach;
	for (int32_t i = -b.reach; i <= b.reach; i++) {
		/* (1 - x^2 / 2n)^n tends to exp(-x^2 / 2); n = 32. */
		float x = (float)i / sigma, v = maxf(1 - x * x / 64, 0);

		for (int k = 0; k < 5; k++)
			v *= v;
		b.weight[i + b.reach] = v;
		sum += v;
	}
	for (int32_t i = 0; i <= 2 * b.reach; i++)
		b.weight[i] /= sum;
	return b;
}

/* 2^stops. */
DIO_SIM_FN float exposure_gain(float stops)
{
	float gain = 1;
	int32_t whole = floor_int(clampf(stops, -16, 16));
	float part = clampf(stops, -16, 16) - (float)whole;

	for (int32_t i = 0; i < whole; i++)
		gain *= 2;
	for (int32_t i = whole; i < 0; i++)
		gain *= 0.5f;
	/* 2^x on [0, 1), within 1e-4. */
	return gain * (1 + part * (0.695502f + part * (0.226171f + part * 0.078204f)));
}

/* What all pixels of a picture are multiplied with. */
struct exposure {
	float gain[3]; /* of each channel */
	float fall;    /* light lost at one pixel from the middle; grows with the square */
	float mid_x, mid_y;
};

DIO_SIM_FN struct exposure exposure_of(const struct dio_sim_sensor *sensor,
				       const struct dio_sim_camera *camera, float gain)
{
	float w = (float)camera->width, h = (float)camera->height;
	struct exposure e;

	gain *= exposure_gain(sensor->exposure_stops);
	for (int c = 0; c < 3; c++)
		e.gain[c] = gain * (sensor->white_balance[c] > 0 ? sensor->white_balance[c] : 1);
	e.fall = sensor->vignetting * 4 / (w * w + h * h);
	e.mid_x = 0.5f * (w - 1);
	e.mid_y = 0.5f * (h - 1);
	return e;
}

/* Share of light that reaches a pixel. */
DIO_SIM_FN float exposure_share(const struct exposure *e, uint32_t x, uint32_t y)
{
	float dx = (float)x - e->mid_x, dy = (float)y - e->mid_y;

	return 1 - e->fall * (dx * dx + dy * dy);
}

/* Straight up to 0.7, then a shoulder that reaches 1 at 1.3: highlights keep some shape. */
DIO_SIM_FN float shoulder(float x)
{
	float t = minf((x - 0.7f) / 0.6f, 1), bent = 0.7f + 0.3f * t * (2 - t);

	return x <= 0.7f ? x : bent;
}

/* Linear light to a value of the picture. */
DIO_SIM_FN float developed(float light)
{
	return srgb_encode(shoulder(light));
}

/* Mean 0, variance 1: eight 8-bit throws summed, near enough to a bell for a sensor. */
DIO_SIM_FN float bell(uint32_t a, uint32_t b)
{
	uint32_t sum = (a & 255) + (a >> 8 & 255) + (a >> 16 & 255) + (a >> 24) + (b & 255) +
		       (b >> 8 & 255) + (b >> 16 & 255) + (b >> 24);

	/* Each throw has variance (256^2 - 1) / 12. */
	return ((float)sum - 8 * 127.5f) * (1 / 209.0220f);
}

/* Value number `i` of a picture with read and shot noise. */
DIO_SIM_FN float noisy(const struct dio_sim_sensor *sensor, uint32_t i, float value)
{
	float read2 = sensor->noise * sensor->noise;
	float shot2 = sensor->shot_noise * sensor->shot_noise;
	uint32_t lo = (uint32_t)sensor->noise_seed, hi = (uint32_t)(sensor->noise_seed >> 32);
	uint32_t a = hash_u32(i ^ lo), b = hash_u32(a + (hi ^ 0x9e3779b9u));

	return saturate(value + sqrtf(read2 + shot2 * value) * bell(b, hash_u32(b ^ a)));
}

DIO_SIM_FN bool sensor_is_noisy(const struct dio_sim_sensor *sensor)
{
	return sensor->noise > 0 || sensor->shot_noise > 0;
}

/* Value in [0, 1] as a byte. */
DIO_SIM_FN uint8_t quantised(float value)
{
	return (uint8_t)(value * 255 + 0.5f);
}

#endif
