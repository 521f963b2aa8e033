/* What lens and sensor do to light, and its encoding. */
#include "sensor.h"

#include <stdlib.h>
#include <string.h>

#include "develop.h"
#include "jpeg.h"

/* A row of pixels with its ends drawn out, mixed into `out`. */
static void blur_row(const struct blur *b, float *line, uint32_t width, float *out)
{
	size_t reach = (size_t)b->reach, values = (size_t)width * 3;
	float *first = line + 3 * reach;

	memcpy(first, out, values * sizeof(float));
	for (size_t i = 0; i < reach; i++) {
		memcpy(line + 3 * i, out, 3 * sizeof(float));
		memcpy(first + values + 3 * i, out + values - 3, 3 * sizeof(float));
	}
	for (size_t i = 0; i < values; i++)
		out[i] = b->weight[0] * line[i];
	for (size_t k = 1; k <= 2 * reach; k++)
		for (size_t i = 0; i < values; i++)
			out[i] += b->weight[k] * line[3 * k + i];
}

/* Row y as the rows above and below it make it. */
static void blur_down(const struct blur *b, const float *copy, size_t values, uint32_t height,
		      uint32_t y, float *out)
{
	for (size_t i = 0; i < values; i++)
		out[i] = 0;
	for (int32_t k = -b->reach; k <= b->reach; k++) {
		int32_t v = (int32_t)y + k, last = (int32_t)height - 1;
		const float *row = copy + (size_t)(v < 0 ? 0 : v > last ? last : v) * values;
		float weight = b->weight[k + b->reach];

		for (size_t i = 0; i < values; i++)
			out[i] += weight * row[i];
	}
}

static bool blur(float *rgb, uint32_t width, uint32_t height, const struct blur *b)
{
	size_t values = (size_t)width * 3, ends = 2 * (size_t)b->reach * 3;
	float *copy = malloc((values * height + ends) * sizeof(float));

	if (!copy)
		return false;
	for (uint32_t y = 0; y < height; y++)
		blur_row(b, copy, width, rgb + y * values);
	memcpy(copy, rgb, values * height * sizeof(float));
	for (uint32_t y = 0; y < height; y++)
		blur_down(b, copy, values, height, y, rgb + y * values);
	free(copy);
	return true;
}

bool sim_sensor_expose(const struct dio_sim_sensor *sensor, const struct dio_sim_camera *camera,
		       float gain, float *rgb)
{
	struct exposure e = exposure_of(sensor, camera, gain);
	struct blur b = blur_of(sensor->blur_px);
	uint32_t w = camera->width, h = camera->height;

	if (b.reach > 0 && !blur(rgb, w, h, &b))
		return false;
	for (uint32_t y = 0; y < h; y++) {
		float *row = rgb + (size_t)y * w * 3;

		for (uint32_t x = 0; x < w; x++) {
			float share = exposure_share(&e, x, y);

			for (uint32_t c = 0; c < 3; c++)
				row[3 * x + c] *= e.gain[c] * share;
		}
		for (uint32_t i = 0; i < 3 * w; i++) /* without branches: vectors */
			row[i] = developed(row[i]);
	}
	return true;
}

void sim_sensor_add_noise(const struct dio_sim_sensor *sensor, size_t values, float *rgb)
{
	if (!sensor_is_noisy(sensor))
		return;
	for (size_t i = 0; i < values; i++)
		rgb[i] = noisy(sensor, (uint32_t)i, rgb[i]);
}

void sim_sensor_compress(const struct dio_sim_sensor *sensor, const struct dio_sim_camera *camera,
			 float *rgb)
{
	if (sensor->jpeg_quality <= 0)
		return;
	for (uint32_t y = 0; y < camera->height; y += SIM_JPEG_SQUARE)
		for (uint32_t x = 0; x < camera->width; x += SIM_JPEG_SQUARE)
			jpeg_square(rgb, camera->width, camera->height, x, y, sensor->jpeg_quality);
}

void sim_sensor_quantise(const float *rgb, size_t values, uint8_t *bytes)
{
	for (size_t i = 0; i < values; i++)
		bytes[i] = quantised(rgb[i]);
}
