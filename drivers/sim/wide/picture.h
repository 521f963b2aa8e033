/* The passes over a tile with its rays side by side: see ../picture.h. */
#ifndef DIO_SIM_WIDE_PICTURE_H
#define DIO_SIM_WIDE_PICTURE_H

#include "../picture.h"
#include "shade.h"

enum {
	TILE_RAYS = SIM_TILE * SIM_TILE,
	TILE_PACKETS = TILE_RAYS / LANES,
};

/* Lanes of packet `index` that hold one of `count` rays. */
static inline wm packet_lanes(uint32_t count, uint32_t index)
{
	uint32_t left = count - index * LANES;

	return wm_of_bits(left >= LANES ? ALL_LANES : (1u << left) - 1);
}

/* Directions of rays, before they get unit length. */
struct bundle {
	float x[TILE_RAYS], y[TILE_RAYS], z[TILE_RAYS];
};

static inline void bundle_put(struct bundle *b, uint32_t i, const double *m, double x, double y)
{
	b->x[i] = (float)(m[0] * x + m[1] * y + m[2]);
	b->y[i] = (float)(m[4] * x + m[5] * y + m[6]);
	b->z[i] = (float)(m[8] * x + m[9] * y + m[10]);
}

static struct wide_ray bundle_packet(const struct bundle *b, const struct dio_sim_camera *c,
				     uint32_t index)
{
	const double *m = c->world_from_camera;
	struct wide_ray r;

	r.from = w3_of(v3((float)m[3], (float)m[7], (float)m[11]));
	r.along = w3_unit(w3(wf_load(b->x + index * LANES), wf_load(b->y + index * LANES),
			     wf_load(b->z + index * LANES)));
	r.spread = (float)(1 / c->fx);
	return r;
}

/* A ray through the centre of every pixel of a tile, row by row; how many. */
static uint32_t bundle_of_tile(const struct dio_sim_camera *c, const struct tile *t,
			       struct bundle *b)
{
	bool pinhole = lens_is_pinhole(c);
	double column[SIM_TILE] = {0};
	uint32_t n = 0;

	for (uint32_t x = t->x0; x < t->x1; x++)
		column[x - t->x0] = (x - c->cx) / c->fx;
	for (uint32_t y = t->y0; y < t->y1; y++) {
		double row = (y - c->cy) / c->fy;

		for (uint32_t x = t->x0; x < t->x1; x++, n++) {
			struct lens_point q = {.x = column[x - t->x0], .y = row};

			if (!pinhole)
				q = lens_at(c, x, y);
			bundle_put(b, n, c->world_from_camera, q.x, q.y);
		}
	}
	for (uint32_t i = n; i < TILE_RAYS; i++)
		bundle_put(b, i, c->world_from_camera, 0, 0);
	return n;
}

/* As tile_look_round(): what may shade the points that a tile's rays met. */
static void look_round(const struct picture *p, struct tile *t, const struct wide_hit *hits,
		       uint32_t packets)
{
	wf far = wf_of(SIM_FAR);
	struct w3 low = w3(far, far, far), high = w3(-far, -far, -far);
	struct v3 lo, hi, room;

	for (uint32_t i = 0; i < packets; i++) {
		const struct w3 *q = &hits[i].point;
		wm m = hits[i].met;

		low = w3_choose(
			m, w3(wf_min(low.x, q->x), wf_min(low.y, q->y), wf_min(low.z, q->z)), low);
		high = w3_choose(
			m, w3(wf_max(high.x, q->x), wf_max(high.y, q->y), wf_max(high.z, q->z)),
			high);
	}
	lo = v3(wf_least(low.x), wf_least(low.y), wf_least(low.z));
	hi = v3(wf_greatest(high.x), wf_greatest(high.y), wf_greatest(high.z));
	if (lo.x > hi.x) /* nothing but sky */
		lo = hi = v3(0, 0, 0);
	room = v3_scale(v3_sub(hi, lo), 0.1f);
	room = v3_add(room, v3(1e-4f, 1e-4f, 1e-4f));
	t->near = neighbourhood_of(p->scene, v3_sub(lo, room), v3_add(hi, room));
}

/* The lanes of some vectors, one after another. */
struct spread_colour {
	float x[LANES], y[LANES], z[LANES];
};

static inline void spread(struct w3 c, struct spread_colour *out)
{
	wf_store(out->x, c.x);
	wf_store(out->y, c.y);
	wf_store(out->z, c.z);
}

static inline struct v3 spread_at(const struct spread_colour *c, uint32_t i)
{
	return v3(c->x[i], c->y[i], c->z[i]);
}

/* What packet `index` of a tile brought, to its pixels. */
static void deliver(const struct picture *p, const struct tile *t, uint32_t index, uint32_t count,
		    struct w3 light, const struct wide_response *response, wu id)
{
	uint32_t across = t->x1 - t->x0, ids[LANES], lamps[LANES];
	struct spread_colour rgb, gain, plus;

	spread(light, &rgb);
	spread(response->gain, &gain);
	spread(response->plus, &plus);
	wu_store(ids, id);
	wu_store(lamps, response->lamps);
	for (uint32_t i = 0; i < LANES && index * LANES + i < count; i++) {
		uint32_t n = index * LANES + i, x = t->x0 + n % across, y = t->y0 + n / across;
		size_t at = (size_t)y * p->camera->width + x;

		store(p->rgb + 3 * at, spread_at(&rgb, i));
		p->response[at].gain = spread_at(&gain, i);
		p->response[at].plus = spread_at(&plus, i);
		p->response[at].lamps = (uint8_t)lamps[i];
		p->surface[at] = (uint16_t)ids[i];
	}
}

/* One ray through the centre of every pixel of a tile. */
static void first_pass(const struct picture *p, uint32_t index)
{
	const struct asking all = {.all = true};
	struct tile *t = &p->tiles[index];
	struct wide_hit hits[TILE_PACKETS];
	struct wide_ray rays[TILE_PACKETS];
	struct candidates met;
	struct nearby near;
	struct bundle bundle;
	uint32_t count, packets;

	tile_begin(p, index, t);
	candidates_of_set(&t->met, &met);
	count = bundle_of_tile(p->camera, t, &bundle);
	packets = (count + LANES - 1) / LANES;
	for (uint32_t i = 0; i < packets; i++) {
		rays[i] = bundle_packet(&bundle, p->camera, i);
		wide_trace_nearest(p->scene, &rays[i], &met, packet_lanes(count, i), &hits[i]);
	}
	look_round(p, t, hits, packets);
	near = nearby_of(p->scene, &t->near);
	for (uint32_t i = 0; i < packets; i++) {
		struct wide_response response;
		struct w3 light =
			wide_light_from(p->scene, &rays[i], &hits[i], p->pixel_angle, &all, &near,
					wm_all(), packet_lanes(count, i), &response);

		deliver(p, t, i, count, light, &response, hits[i].id);
	}
}

/* A ray of a pixel that gets several. */
struct sample {
	uint8_t pixel; /* place in the list of such pixels */
	uint8_t turn;
	uint8_t shows; /* place in what is around the pixel; its count: something else */
	bool copied;   /* it brings what an earlier ray of its pixel brought from there */
};

/* Pixels that get several rays, as far as their rays fit. */
struct batch {
	uint32_t pixels, rays;
	size_t at[TILE_RAYS];
	struct around around[TILE_RAYS];
	struct sample sample[TILE_RAYS];
	struct bundle bundle;
	struct v3 light[TILE_RAYS];
};

/* pixel_refine()'s rays of a pixel, its number of samples squared at most. */
static void batch_add(const struct picture *p, uint32_t x, uint32_t y, struct batch *b)
{
	struct lens_point q = lens_at(p->camera, x, y);
	size_t i = (size_t)y * p->camera->width + x;
	struct around *around = &b->around[b->pixels];
	bool half = p->refine[i] == REFINE_PRINT;
	uint32_t n = p->samples;

	look_around(p, x, y, around);
	around->colour[0] = v3(p->rgb[3 * i], p->rgb[3 * i + 1], p->rgb[3 * i + 2]);
	around->known[0] = true;
	for (uint32_t k = 0; k < n * n; k++) {
		double du = (k % n + 0.5) / n - 0.5, dv = (k / n + 0.5) / n - 0.5;

		if (half && (k % n + k / n) % 2)
			continue;
		b->sample[b->rays].pixel = (uint8_t)b->pixels;
		b->sample[b->rays].turn = (uint8_t)k;
		bundle_put(&b->bundle, b->rays++, p->camera->world_from_camera,
			   q.x + q.dx_du * du + q.dx_dv * dv, q.y + q.dy_du * du + q.dy_dv * dv);
	}
	b->at[b->pixels++] = i;
}

/* What each lane may meet is what its pixel and that one's neighbours show. */
static void batch_candidates(const struct batch *b, uint32_t first, uint32_t count,
			     struct candidates *c)
{
	uint32_t lanes[SIM_MAX_PRIMS] = {0};
	struct prim_set any = set_of_none();

	for (uint32_t i = 0; i < count; i++) {
		const struct prim_set *set = &b->around[b->sample[first + i].pixel].prims;

		for (uint32_t w = 0; w < SIM_SET_WORDS; w++) {
			any.word[w] |= set->word[w];
			for (uint64_t left = set->word[w]; left; left &= left - 1)
				lanes[64 * w + lowest_bit(left)] |= 1u << i;
		}
	}
	candidates_of_set(&any, c);
	for (uint32_t i = 0; i < c->count; i++)
		c->lanes[i] = lanes[c->prim[i]];
}

/* How the rays of a packet get their light: lanes that need all of it, lanes that find it in the
 * light of a neighbour's ray (its response is put down); the others copy an earlier ray's. */
struct packet_plan {
	uint32_t lit, textured;
	struct spread_colour gain, plus;
};

static void packet_plan_make(const struct picture *p, struct batch *b, uint32_t first,
			     uint32_t count, const struct wide_hit *hit, struct packet_plan *plan)
{
	uint32_t ids[LANES], met = wm_bits(hit->met);

	memset(plan, 0, sizeof(*plan));
	wu_store(ids, hit->id);
	for (uint32_t i = 0; i < count; i++) {
		struct sample *sample = &b->sample[first + i];
		struct around *a = &b->around[sample->pixel];
		uint8_t refine = p->refine[b->at[sample->pixel]];
		uint32_t shows = 0;

		while (shows < a->count && a->surface[shows] != (uint16_t)ids[i])
			shows++;
		sample->shows = (uint8_t)shows;
		sample->copied = false;
		if (refine & REFINE_LIGHT || shows == a->count || !(met >> i & 1)) {
			plan->lit |= 1u << i;
		} else if (a->known[shows] && !(refine & REFINE_PRINT)) {
			sample->copied = true;
		} else {
			const struct response *r = &p->response[a->shown_by[shows]];

			plan->textured |= 1u << i;
			plan->gain.x[i] = r->gain.x;
			plan->gain.y[i] = r->gain.y;
			plan->gain.z[i] = r->gain.z;
			plan->plus.x[i] = r->plus.x;
			plan->plus.y[i] = r->plus.y;
			plan->plus.z[i] = r->plus.z;
		}
		if (shows < a->count)
			a->known[shows] = true;
	}
}

static wu packet_turns(const struct batch *b, uint32_t first, uint32_t count)
{
	uint32_t turns[LANES] = {0};

	for (uint32_t i = 0; i < count; i++)
		turns[i] = b->sample[first + i].turn;
	return wu_load(turns);
}

static wm packet_held(const struct neighbourhood *n, struct w3 p)
{
	wm x = wm_and(wf_ge(p.x, wf_of(n->lo.x)), wf_le(p.x, wf_of(n->hi.x)));
	wm y = wm_and(wf_ge(p.y, wf_of(n->lo.y)), wf_le(p.y, wf_of(n->hi.y)));
	wm z = wm_and(wf_ge(p.z, wf_of(n->lo.z)), wf_le(p.z, wf_of(n->hi.z)));

	return wm_and(x, wm_and(y, z));
}

/* sample_light() of the rays from `first` on that fill one packet. */
static void batch_light(const struct picture *p, const struct nearby *near, struct batch *b,
			uint32_t first)
{
	uint32_t count = b->rays - first < LANES ? b->rays - first : LANES;
	struct wide_ray r = bundle_packet(&b->bundle, p->camera, first / LANES);
	float pixel_angle = p->pixel_angle / (float)p->samples;
	wf zero = wf_of(0), two = wf_of(2);
	struct w3 light = w3(zero, zero, zero);
	struct spread_colour out;
	struct packet_plan plan;
	struct candidates c;
	struct wide_hit hit;
	wm m;

	batch_candidates(b, first, count, &c);
	wide_trace_nearest(p->scene, &r, &c, packet_lanes(b->rays, first / LANES), &hit);
	packet_plan_make(p, b, first, count, &hit, &plan);
	m = wm_of_bits(plan.lit);
	if (plan.lit) {
		const struct asking asking = {.turn = packet_turns(b, first, count)};
		wm held = wm_or(packet_held(near->near, hit.point), wm_not(wm_and(m, hit.met)));
		struct wide_response response;

		light = wide_light_from(p->scene, &r, &hit, pixel_angle, &asking, near, held, m,
					&response);
	}
	if (plan.textured) {
		struct wide_response neighbour;
		struct wide_finish f;

		m = wm_of_bits(plan.textured);
		wide_hit_finish(p->scene, &r, &hit, wf_of(pixel_angle), m, &f);
		neighbour.gain =
			w3(wf_load(plan.gain.x), wf_load(plan.gain.y), wf_load(plan.gain.z));
		neighbour.plus =
			w3(wf_load(plan.plus.x), wf_load(plan.plus.y), wf_load(plan.plus.z));
		light = w3_choose(m, wide_response_to(&neighbour, f.albedo), light);
	}
	/* A glint must not outweigh the rest of the pixel: the sensor clips later. */
	light = w3(wf_min(light.x, two), wf_min(light.y, two), wf_min(light.z, two));
	spread(light, &out);
	for (uint32_t i = 0; i < count; i++)
		b->light[first + i] = spread_at(&out, i);
}

/* All rays of a batch, and the means over each pixel's. */
static void batch_finish(const struct picture *p, const struct nearby *near, struct batch *b)
{
	uint32_t i = 0;

	for (uint32_t k = b->rays; k % LANES; k++)
		bundle_put(&b->bundle, k, p->camera->world_from_camera, 0, 0);
	for (uint32_t first = 0; first < b->rays; first += LANES)
		batch_light(p, near, b, first);
	for (uint32_t k = 0; k < b->pixels; k++) {
		struct around *a = &b->around[k];
		struct v3 sum = v3(0, 0, 0);
		uint32_t taken = 0;

		for (; i < b->rays && b->sample[i].pixel == k; i++, taken++) {
			const struct sample *s = &b->sample[i];
			struct v3 c = s->copied ? a->colour[s->shows] : b->light[i];

			if (s->shows < a->count)
				a->colour[s->shows] = c;
			sum = v3_add(sum, c);
		}
		store(p->rgb + 3 * b->at[k], v3_scale(sum, 1 / (float)taken));
	}
	b->pixels = b->rays = 0;
}

/* Pixels of a tile that differ from a neighbour: means over several rays. */
static void second_pass(const struct picture *p, const struct tile *t)
{
	struct nearby near = nearby_of(p->scene, &t->near);
	uint32_t most = p->samples * p->samples;
	struct batch b;

	b.pixels = b.rays = 0;
	for (uint32_t y = t->y0; y < t->y1; y++) {
		for (uint32_t x = t->x0; x < t->x1; x++) {
			if (!p->refine[(size_t)y * p->camera->width + x])
				continue;
			if (b.rays + most > TILE_RAYS)
				batch_finish(p, &near, &b);
			batch_add(p, x, y, &b);
		}
	}
	if (b.rays)
		batch_finish(p, &near, &b);
}

#endif
