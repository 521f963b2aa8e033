/* One thing, or a few, before a plain backdrop: product shots, museum pieces, renderings. */
#include "build.h"

static struct v3 backdrop_colour(struct rng *r)
{
	float kind = rng_unit(r), v;

	if (kind < 0.45f)
		return v3(1.6f, 1.6f, 1.6f); /* clips to pure white */
	if (kind < 0.7f) {
		v = rng_chance(r, 0.6f) ? 0 : 0.004f;
		return v3(v, v, v);
	}
	if (kind < 0.9f) {
		v = rng_in(r, 0.05f, 0.8f);
		return v3(v, v, v);
	}
	return sim_colour_any(r);
}

void sim_build_turntable(struct dio_sim_scene *s, struct rng *r)
{
	float size = rng_in(r, 0.08f, 0.2f), kind = rng_unit(r), spread = 0;
	uint32_t count = 1;

	if (kind > 0.8f) { /* a few things beside one another */
		count = 2 + rng_below(r, 3);
		spread = 1.4f * size;
	} else if (kind > 0.4f) { /* grown together: models, figures, machines */
		count = 2 + rng_below(r, 4);
		spread = 0.45f * size;
	}

	s->surround = SURROUND_PLAIN;
	s->sky[0] = backdrop_colour(r);
	s->extent = size + spread;
	s->focus = v3(0, 0, 0.75f * size);
	if (rng_chance(r, 0.35f)) { /* standing on paper of the same tone, with its shadow */
		s->has_ground = true;
		s->ground = sim_material_plain(v3_scale(s->sky[0], 0.6f));
		s->ground.colour[0] =
			v3(minf(s->ground.colour[0].x, 0.9f), minf(s->ground.colour[0].y, 0.9f),
			   minf(s->ground.colour[0].z, 0.9f));
	}
	sim_lights_indoor(s, r);
	for (uint32_t i = 0; i < count; i++)
		sim_object_add(s, r, rng_about(r, spread, spread, 0), size);
}
