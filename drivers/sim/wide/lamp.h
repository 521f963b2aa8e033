/* How much of a lamp several points see: see lamp_seen() in ../shade.h, whose every step this takes
 * for each lane. */
#ifndef DIO_SIM_WIDE_LAMP_H
#define DIO_SIM_WIDE_LAMP_H

#include "../shade.h"
#include "trace.h"

/* Which points of a lamp a packet of rays asks about: see lamp_seen(). */
struct asking {
	bool centre, all;
	wu turn; /* where neither */
};

/* What rays to a lamp leave from, and what may stand in their way. */
struct lamp_rays {
	struct w3 from, to;
	wf limit, size;
	float spread;
	wu owner;
	const struct prim_set *before; /* for lanes of `held`; other lanes lie anywhere */
	wm held;
};

/* Everything that rays of `lanes` to a lamp might meet. */
static void lamp_candidates(const struct dio_sim_scene *s, const struct lamp_rays *l, wm lanes,
			    wm sharp, struct candidates *c)
{
	wf slope = wf_choose(sharp, wf_of(0), l->size);
	struct wide_beam beam = wide_beam_of(l->from, l->to, l->limit, slope);
	wm held = wm_and(lanes, l->held), loose = wm_less(lanes, l->held);

	c->count = 0;
	if (wm_any(loose)) {
		add_of_beam(s, &beam, loose, c);
		remove_clear(s, c);
	}
	if (!wm_any(held) || set_is_empty(l->before)) {
		remove_own(s, l->owner, c);
		return;
	}
	if (c->count > 0) { /* both: lanes of one kind at a time would only look twice */
		struct candidates more;

		more.count = 0;
		add_within_beam(s, l->before, &beam, held, sharp, &more);
		for (uint32_t i = 0; i < more.count; i++) {
			uint32_t k = 0;

			while (k < c->count && c->prim[k] != more.prim[i])
				k++;
			if (k < c->count)
				c->lanes[k] |= more.lanes[i];
			else
				candidate_add(c, more.prim[i], more.lanes[i]);
		}
	} else {
		add_within_beam(s, l->before, &beam, held, sharp, c);
	}
	remove_own(s, l->owner, c);
}

/* Share of a lamp that lanes of `lanes` see, those with candidates, by up to four rays. */
static wf soft_lamp_seen(const struct dio_sim_scene *s, const struct lamp_rays *l,
			 const struct candidates *c, const struct asking *asking, wm lanes)
{
	const float turn_cos[SIM_LAMP_TURNS] = {0.7f, 0.647f, 0.495f, 0.268f};
	const float turn_sin[SIM_LAMP_TURNS] = {0.0f, 0.268f, 0.495f, 0.647f};
	wf across = wf_of(turn_cos[0]), along = wf_of(turn_sin[0]), seen = wf_of(0), x, y;
	wf one = wf_of(1), zero = wf_of(0), result = zero;
	struct w3 upright = w3_of(v3(0, 0, 1)), level = w3_of(v3(1, 0, 0)), u, v;
	struct wide_ray r;
	wm done, clear;

	for (uint32_t i = 1; i < SIM_LAMP_TURNS && !asking->all; i++) {
		done = wu_eq(asking->turn & wu_of(SIM_LAMP_TURNS - 1), wu_of(i));
		across = wf_choose(done, wf_of(turn_cos[i]), across);
		along = wf_choose(done, wf_of(turn_sin[i]), along);
	}
	across = l->size * across;
	along = l->size * along;
	u = w3_unit(
		w3_cross(l->to, w3_choose(wf_lt(wf_abs(l->to.z), wf_of(0.9f)), upright, level)));
	v = w3_cross(l->to, u);
	r.from = l->from;
	r.spread = l->spread;
	for (int i = 0; i < 4; i++) {
		if (i == 2 && !asking->all)
			return wf_of(0.5f) * seen;
		done = wm_none();
		if (i == 2) /* the two agree */
			done = wm_and(wf_lt(l->size, wf_of(SIM_NARROW_LAMP)),
				      wm_not(wf_eq(seen, one)));
		if (i == 3)
			done = wm_or(wf_eq(seen, zero), wf_eq(seen, wf_of(3)));
		done = wm_and(done, lanes);
		result = wf_choose(done, wf_min(seen, one), result);
		lanes = wm_less(lanes, done);
		if (!wm_any(lanes))
			return result;
		x = i == 0 ? across : i == 1 ? -across : i == 2 ? -along : along;
		y = i == 0 ? along : i == 1 ? -along : i == 2 ? across : -across;
		r.along = w3_unit(w3_mad(w3_mad(l->to, u, x), v, y));
		clear = wm_less(lanes, wide_trace_blocked(s, &r, c, lanes, l->limit));
		seen += wf_choose(clear, one, zero);
	}
	return wf_choose(lanes, wf_of(0.25f) * seen, result);
}

/* Share of the lamp that lanes of `lanes` see. */
static wf wide_lamp_seen(const struct dio_sim_scene *s, const struct lamp_rays *l,
			 const struct asking *asking, wm lanes)
{
	wm sharp = asking->centre ? wm_all() : wf_lt(l->size, wf_of(0.004f)), shaded, m;
	wf seen = wf_of(1), zero = wf_of(0);
	struct candidates c;
	uint32_t any = 0;

	if (!wm_any(wm_less(lanes, l->held)) && set_is_empty(l->before))
		return seen;
	lamp_candidates(s, l, lanes, sharp, &c);
	for (uint32_t i = 0; i < c.count; i++)
		any |= c.lanes[i];
	shaded = wm_and(lanes, wm_of_bits(any));
	m = wm_and(shaded, sharp);
	if (wm_any(m)) {
		struct wide_ray r = {l->from, l->to, l->spread};

		seen = wf_choose(wide_trace_blocked(s, &r, &c, m, l->limit), zero, seen);
	}
	m = wm_less(shaded, sharp);
	if (wm_any(m))
		seen = wf_choose(m, soft_lamp_seen(s, l, &c, asking, m), seen);
	return seen;
}

/* Lanes of `lanes` whose light from a lamp comes through clear glass. */
static wm wide_lamp_behind_glass(const struct dio_sim_scene *s, const struct lamp_rays *l, wm lanes)
{
	struct prim_set glass = set_of_clear(s);
	struct wide_ray r = {l->from, l->to, l->spread};
	struct candidates c;

	candidates_of_set(&glass, &c);
	remove_own(s, l->owner, &c);
	return wide_trace_blocked(s, &r, &c, lanes, l->limit);
}

#endif
