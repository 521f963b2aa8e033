/* Photographs as textures: pictures handed to the library once, shrunk by halves for filtering. */
#ifndef DIO_SIM_PHOTO_H
#define DIO_SIM_PHOTO_H

#include "vec.h"

struct dio_sim_scene;

/* Square sRGB pictures, each with its halvings down to one pixel behind it. */
struct sim_photos {
	const uint8_t *pixels; /* [count][photo_bytes(side)] */
	uint32_t side;         /* a power of two */
	uint32_t count;
};

/* Bytes of a picture with its halvings. */
DIO_SIM_FN size_t photo_bytes(uint32_t side)
{
	size_t bytes = 0;

	for (; side; side /= 2)
		bytes += (size_t)side * side * 3;
	return bytes;
}

/* Position on a line of pixels that is mirrored at both ends: the two pixels to mix. */
DIO_SIM_FN float photo_split(float u, uint32_t side, uint32_t *first, uint32_t *second)
{
	float f = 2 * fract(0.5f * u), x, at;
	int32_t i;

	f = f > 1 ? 2 - f : f;
	x = f * (float)side - 0.5f;
	at = clampf(x, 0, (float)side - 1);
	i = (int32_t)at;
	*first = (uint32_t)i;
	*second = (uint32_t)i + 1 < side ? (uint32_t)i + 1 : (uint32_t)i;
	return at - (float)i;
}

/* Linear colour of picture `index` at (u, v), its first pixel at (0, 0), its last at (1, 1), seen
 * through a filter of `width`. Beyond its edges it goes on mirrored. */
DIO_SIM_FN struct v3 photo_colour(const struct sim_photos *photos, uint32_t index, float u, float v,
				  float width)
{
	const uint8_t *level = photos->pixels + index * photo_bytes(photos->side), *row[2];
	uint32_t side = photos->side, x[2], y[2];
	float across, down, rgb[3];

	for (; side > 1 && width * (float)side > 1.4f; side /= 2)
		level += (size_t)side * side * 3;
	across = photo_split(u, side, &x[0], &x[1]);
	down = photo_split(v, side, &y[0], &y[1]);
	row[0] = level + (size_t)y[0] * side * 3;
	row[1] = level + (size_t)y[1] * side * 3;
	for (int c = 0; c < 3; c++) {
		float top = mixf(row[0][3 * x[0] + (uint32_t)c], row[0][3 * x[1] + (uint32_t)c],
				 across);
		float low = mixf(row[1][3 * x[0] + (uint32_t)c], row[1][3 * x[1] + (uint32_t)c],
				 across);

		rgb[c] = srgb_decode(mixf(top, low, down) * (1.0f / 255));
	}
	return v3(rgb[0], rgb[1], rgb[2]);
}

/** The pictures that scenes made from now on may show; count 0 when there are none. */
struct sim_photos sim_photos_get(void);

/** Put photographs in the place of some of a built scene's textures. Without photographs nothing
 * changes; which textures they replace follows from the materials' seeds. */
void sim_photos_hang(struct dio_sim_scene *scene);

#endif
