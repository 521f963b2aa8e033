/* What lens and sensor do to light, and its encoding. */
#include "sensor.h"

#include "jpeg.h"

#include <stdlib.h>
#include <string.h>

enum { BLUR_REACH = 12 };

static float gain_of(float stops)
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

static void blur_line(const float *in, float *out, size_t count, size_t stride, const float *kernel,
		      int32_t reach)
{
	int32_t n = (int32_t)count;

	for (int32_t i = 0; i < n; i++) {
		for (int32_t c = 0; c < 3; c++) {
			float sum = 0;

			for (int32_t k = -reach; k <= reach; k++) {
				int32_t at = i + k < 0 ? 0 : i + k >= n ? n - 1 : i + k;

				sum += kernel[k + reach] * in[(size_t)at * 3 + (size_t)c];
			}
			out[(size_t)i * stride + (size_t)c] = sum;
		}
	}
}

/* A bell from repeated boxes is close to a Gaussian and needs no exp(). */
static int32_t blur_kernel(float sigma, float *kernel)
{
	int32_t reach = floor_int(3 * sigma) + 1;
	float sum = 0;

	reach = reach > BLUR_REACH ? BLUR_REACH : reach;
	for (int32_t i = -reach; i <= reach; i++) {
		/* (1 - x^2 / 2n)^n tends to exp(-x^2 / 2); n = 32. */
		float x = (float)i / sigma, v = maxf(1 - x * x / 64, 0);

		for (int k = 0; k < 5; k++)
			v *= v;
		kernel[i + reach] = v;
		sum += v;
	}
	for (int32_t i = 0; i <= 2 * reach; i++)
		kernel[i] /= sum;
	return reach;
}

static bool blur(float *rgb, uint32_t width, uint32_t height, float sigma)
{
	float kernel[2 * BLUR_REACH + 1] = {0};
	int32_t reach = blur_kernel(sigma, kernel);
	size_t longest = width > height ? width : height;
	float *line = malloc(longest * 3 * sizeof(float));

	if (!line)
		return false;
	for (uint32_t y = 0; y < height; y++) {
		float *row = rgb + (size_t)y * width * 3;

		memcpy(line, row, (size_t)width * 3 * sizeof(float));
		blur_line(line, row, width, 3, kernel, reach);
	}
	for (uint32_t x = 0; x < width; x++) {
		for (uint32_t y = 0; y < height; y++)
			memcpy(line + (size_t)y * 3, rgb + ((size_t)y * width + x) * 3,
			       3 * sizeof(float));
		blur_line(line, rgb + (size_t)x * 3, height, (size_t)width * 3, kernel, reach);
	}
	free(line);
	return true;
}

/* Straight up to 0.7, then a shoulder that reaches 1 at 1.3: highlights keep some shape. */
static float shoulder(float x)
{
	float t = minf((x - 0.7f) / 0.6f, 1), bent = 0.7f + 0.3f * t * (2 - t);

	return x <= 0.7f ? x : bent;
}

bool sim_sensor_expose(const struct dio_sim_sensor *sensor, const struct dio_sim_camera *camera,
		       float gain, float *rgb)
{
	uint32_t w = camera->width, h = camera->height;
	float exposure = gain * gain_of(sensor->exposure_stops), gains[3];
	float scale = 4 / ((float)w * (float)w + (float)h * (float)h);

	if (sensor->blur_px > 0.05f && !blur(rgb, w, h, sensor->blur_px))
		return false;
	for (int c = 0; c < 3; c++)
		gains[c] = exposure * (sensor->white_balance[c] > 0 ? sensor->white_balance[c] : 1);
	for (uint32_t y = 0; y < h; y++) {
		float dy = (float)y + 0.5f - 0.5f * (float)h, *row = rgb + (size_t)y * w * 3;

		for (uint32_t x = 0; x < w; x++) {
			float dx = (float)x + 0.5f - 0.5f * (float)w;
			float fall = 1 - sensor->vignetting * (dx * dx + dy * dy) * scale;

			for (uint32_t c = 0; c < 3; c++)
				row[3 * x + c] *= gains[c] * fall;
		}
		for (uint32_t i = 0; i < 3 * w; i++) /* without branches: vectors */
			row[i] = srgb_encode(shoulder(row[i]));
	}
	return true;
}

/* Mean 0, variance 1: four 8-bit throws summed, twice, near enough to a bell for a sensor. */
static float bell(uint32_t a, uint32_t b)
{
	uint32_t sum = (a & 255) + (a >> 8 & 255) + (a >> 16 & 255) + (a >> 24) + (b & 255) +
		       (b >> 8 & 255) + (b >> 16 & 255) + (b >> 24);

	/* Each throw has variance (256^2 - 1) / 12. */
	return ((float)sum - 8 * 127.5f) * (1 / 209.0220f);
}

void sim_sensor_add_noise(const struct dio_sim_sensor *sensor, size_t values, float *rgb)
{
	uint32_t lo = (uint32_t)sensor->noise_seed, hi = (uint32_t)(sensor->noise_seed >> 32);
	float read2 = sensor->noise * sensor->noise;
	float shot2 = sensor->shot_noise * sensor->shot_noise;

	if (read2 <= 0 && shot2 <= 0)
		return;
	for (size_t i = 0; i < values; i++) {
		uint32_t a = hash_u32((uint32_t)i ^ lo);
		uint32_t b = hash_u32(a + (hi ^ 0x9e3779b9u));
		float sigma = sqrtf(read2 + shot2 * rgb[i]);

		rgb[i] = saturate(rgb[i] + sigma * bell(b, hash_u32(b ^ a)));
	}
}

void sim_sensor_compress(const struct dio_sim_sensor *sensor, const struct dio_sim_camera *camera,
			 float *rgb)
{
	if (sensor->jpeg_quality <= 0)
		return;
	for (uint32_t y = 0; y < camera->height; y += 16)
		for (uint32_t x = 0; x < camera->width; x += 16)
			jpeg_square(rgb, camera->width, camera->height, x, y, sensor->jpeg_quality);
}

void sim_sensor_quantise(const float *rgb, size_t values, uint8_t *bytes)
{
	for (size_t i = 0; i < values; i++)
		bytes[i] = (uint8_t)(rgb[i] * 255 + 0.5f);
}
