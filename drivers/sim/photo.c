/* Photographs handed to the library, and where they hang. */
#include "photo.h"

#include <stdlib.h>
#include <string.h>

#include "scene.h"

enum { SIDE_MOST = 4096 };

static struct sim_photos shown;
static uint8_t *owned;

struct sim_photos sim_photos_get(void)
{
	return shown;
}

static void halve(const uint8_t *from, uint32_t side, uint8_t *to)
{
	uint32_t half = side / 2;

	for (uint32_t y = 0; y < half; y++) {
		const uint8_t *up = from + (size_t)2 * y * side * 3, *low = up + (size_t)side * 3;

		for (uint32_t x = 0; x < half; x++)
			for (uint32_t c = 0; c < 3; c++, to++)
				*to = (uint8_t)((up[6 * x + c] + up[6 * x + 3 + c] +
						 low[6 * x + c] + low[6 * x + 3 + c] + 2) /
						4);
	}
}

int dio_sim_photos_set(const uint8_t *pixels, uint32_t side, uint32_t count)
{
	size_t each = photo_bytes(side), plain = (size_t)side * side * 3;
	uint8_t *copy = NULL;

	if (count > 0) {
		if (!side || side & (side - 1) || side > SIDE_MOST)
			return -1;
		copy = calloc(count, each);
		if (!copy)
			return -1;
	}
	for (uint32_t i = 0; i < count; i++) {
		uint8_t *level = copy + i * each;

		memcpy(level, pixels + i * plain, plain);
		for (uint32_t s = side; s > 1; s /= 2) {
			uint8_t *next = level + (size_t)s * s * 3;

			halve(level, s, next);
			level = next;
		}
	}
	free(owned);
	owned = copy;
	shown.pixels = copy;
	shown.side = side;
	shown.count = count;
	return 0;
}

/* How likely a photograph takes a texture's place: it shows on what is printed, painted or
 * weathered, not on plain things or bricks. */
static float share_of(enum texture_kind kind)
{
	switch (kind) {
	case TEX_PICTURE:
		return 0.8f;
	case TEX_MOTIF:
	case TEX_BLOTCHES:
	case TEX_GRADIENT:
		return 0.4f;
	case TEX_NOISE:
	case TEX_MARBLE:
	case TEX_PRINT:
		return 0.25f;
	default:
		return 0;
	}
}

static void hang_on(struct material *m)
{
	uint32_t h = hash_u32(m->seed ^ 0x9b070u);

	if (unit_from(h) >= share_of(m->texture))
		return;
	/* A picture is about as large as three features of what it replaces, a landscape of noise
	 * about six. */
	m->scale *= m->texture == TEX_PICTURE ? 0.33f : 0.16f;
	m->texture = TEX_PHOTO;
	m->turn_cos = 1; /* upright */
	m->turn_sin = 0;
}

void sim_photos_hang(struct dio_sim_scene *s)
{
	s->photos = sim_photos_get();
	if (!s->photos.count)
		return;
	for (uint32_t i = 0; i < s->prim_count; i++)
		hang_on(&s->prim[i].material);
	for (int i = 0; i < 4; i++)
		hang_on(&s->wall[i]);
	hang_on(&s->ground);
}
