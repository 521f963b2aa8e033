/* Lamps, sun and the light that comes from everywhere. A white wall facing the main light ends
 * near 0.7 of full scale: the camera's automatic exposure. */
#include "build.h"

static struct v3 warm_or_cool(struct rng *r, float reach)
{
	float w = rng_in(r, -reach, reach);

	return v3(1 + w, 1 + 0.2f * absf(w), 1 - w);
}

static void add_far_light(struct dio_sim_scene *s, struct rng *r, float power, float size)
{
	float turn = rng_unit(r), height = rng_in(r, 0.35f, 1.0f);
	float flat = sqrtf(1 - minf(height * height, 0.98f));
	struct light *light = &s->light[s->light_count++];

	light->directional = true;
	light->at = v3_unit(v3(flat * cos_turns(turn), flat * sin_turns(turn), height));
	light->size = size;
	light->colour = v3_scale(warm_or_cool(r, 0.15f), power);
}

static void add_lamp(struct dio_sim_scene *s, struct rng *r, float power, float away)
{
	float turn = rng_unit(r), high = away * rng_in(r, 0.6f, 1.2f),
	      out = away * rng_in(r, 0, 0.9f);
	struct light *light = &s->light[s->light_count++];
	struct v3 d = v3(out * cos_turns(turn), out * sin_turns(turn), high);

	light->directional = false;
	light->at = v3_add(s->focus, d);
	light->size = away * rng_in(r, 0.02f, 0.2f);
	light->colour = v3_scale(warm_or_cool(r, 0.2f), power * (v3_dot(d, d) + 0.01f));
}

void sim_lights_indoor(struct dio_sim_scene *s, struct rng *r)
{
	float share = rng_in(r, 0.25f, 0.75f), ambient = 0.85f * share, rest = 0.95f * (1 - share);
	uint32_t lamps = rng_chance(r, 0.55f) ? 1 : rng_chance(r, 0.7f) ? 2 : 3;
	struct v3 tint = warm_or_cool(r, 0.1f);

	s->ambient_up = v3_scale(tint, ambient);
	s->ambient_down = v3_scale(tint, ambient * rng_in(r, 0.35f, 0.8f));
	for (uint32_t i = 0; i < lamps; i++) {
		float power = rest * (i == 0 ? 1 : rng_in(r, 0.2f, 0.6f));

		if (rng_chance(r, 0.5f))
			add_far_light(s, r, power, rng_in(r, 0, 0.25f));
		else
			add_lamp(s, r, power, s->extent * rng_in(r, 2.5f, 6));
		rest *= 0.7f;
	}
}

void sim_lights_outdoor(struct dio_sim_scene *s, struct rng *r)
{
	float overcast = rng_unit(r), sun = 1 - smooth_step(0.3f, 0.8f, overcast);
	float blue = 0.3f + 0.7f * sun;
	struct v3 sky = sim_hsv_in(r, v3(0.54f, 0.2f * blue, 0.6f), v3(0.64f, 0.65f * blue, 0.95f));
	float grey = rng_in(r, 0.5f, 0.95f);

	s->sky[0] = v3_mix(sky, v3(grey, grey, grey), 0.7f);
	s->sky[1] = sky;
	s->sky[2] = v3_mix(v3(0.95f, 0.95f, 0.95f), v3(0.35f, 0.36f, 0.4f),
			   rng_chance(r, 0.3f) ? 0.7f : 0);
	s->clouds = rng_chance(r, 0.7f) ? rng_in(r, 0.2f, 1) : 0;
	s->ambient_up = v3_scale(v3_mix(s->sky[1], v3(0.7f, 0.7f, 0.7f), 0.6f),
				 rng_in(r, 0.5f, 0.8f) + 0.4f * (1 - sun));
	s->ambient_down = v3_scale(s->ambient_up, rng_in(r, 0.3f, 0.6f));
	if (sun > 0.05f) {
		add_far_light(s, r, 0.9f * sun, 0.006f);
		s->light[s->light_count - 1].colour.z *= 0.85f;
	}
}
