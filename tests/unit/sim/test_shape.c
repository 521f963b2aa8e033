/* Rays find the surfaces of shapes that are walked, not solved. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "build.h"
#include "trace.h"

enum { RAYS = 1500, FINE = 4000 };

static struct dio_sim_scene *scene;
static struct builder builder;
static struct material paint;

static int start(void **state)
{
	struct rng r = rng_seeded(1);

	(void)state;
	scene = calloc(1, sizeof(*scene));
	paint = sim_material_plain(v3(0.5f, 0.5f, 0.5f));
	paint.seed = 77;
	return scene && sim_thing_begin(&builder, scene, &r, v3(0, 0, 0), sim_turned(0)) ? 0 : -1;
}

static int stop(void **state)
{
	(void)state;
	free(scene);
	return 0;
}

/* From a sphere around the shape to a point within it. */
static struct ray random_ray(struct rng *r, const struct prim *p)
{
	struct v3 from = v3_scale(v3_unit(rng_about(r, 1, 1, 1)), 3 * p->bound);
	struct v3 to = rng_about(r, p->reach.x, p->reach.y, p->reach.z);

	return ray_of(from, v3_unit(v3_sub(to, from)), 1e-3f);
}

/* Where the field first falls below zero, by steps too small to miss much; SIM_FAR for nowhere. */
static float patient_walk(const struct prim *p, const struct ray *r)
{
	for (int i = 0; i < FINE; i++) {
		float t = 6 * p->bound * (float)i / FINE;
		struct v3 at = ray_at(r, t);

		if (absf(at.x) <= p->reach.x && absf(at.y) <= p->reach.y &&
		    absf(at.z) <= p->reach.z && field_of(p, at) < 0)
			return t;
	}
	return SIM_FAR;
}

/* Share of rays that end somewhere else than the patient walk. */
static void check_prim(const struct prim *p, const char *name)
{
	struct rng r = rng_seeded(5);
	uint32_t met = 0, wrong = 0, outward = 0;

	for (int i = 0; i < RAYS; i++) {
		struct ray ray = random_ray(&r, p);
		float want = patient_walk(p, &ray);
		struct surface_hit hit = {.t = SIM_FAR};
		bool any = hit_field(p, &ray, &hit);

		met += any;
		if (any != (want < SIM_FAR))
			wrong++;
		else if (any && absf(hit.t - want) > 0.03f * p->bound)
			wrong++;
		if (any)
			outward += v3_dot(field_normal(p, ray_at(&ray, hit.t)), ray.along) < 0.1f;
	}
	print_message("%-16s %4u of %d rays meet it, %u ends differ, %u normals face the ray\n",
		      name, met, RAYS, wrong, outward);
	assert_true(met > RAYS / 4);
	assert_true(wrong < RAYS / 40);
	assert_true(outward > met * 97 / 100);
}

static void rays_find_rocks_and_landscapes(void **state)
{
	(void)state;
	check_prim(sim_add_rock(&builder, v3(0, 0, 0), v3(0.3f, 0.2f, 0.15f), 0.12f, 1, &paint),
		   "smooth rock");
	check_prim(sim_add_rock(&builder, v3(0, 0, 0), v3(0.3f, 0.25f, 0.2f), 0.32f, 3, &paint),
		   "rough rock");
	check_prim(sim_add_relief(&builder, v3(0, 0, 0), v3(0.3f, 0.3f, 0.06f), 0.4f, 2,
				  sim_turned(0), &paint),
		   "low hills");
	check_prim(sim_add_relief(&builder, v3(0, 0, 0), v3(0.3f, 0.2f, 0.12f), 0.85f, 5,
				  sim_turned(0), &paint),
		   "steep hills");
}

static void rays_find_every_carving(void **state)
{
	static const char *const names[] = {"dip", "bore", "slot", "corners", "flutes"};

	(void)state;
	for (int solid = SOLID_BOX; solid <= SOLID_DRUM; solid++) {
		for (int cut = CUT_DIP; cut <= CUT_FLUTES; cut++) {
			float size = cut == CUT_FLUTES ? 0.04f : 0.12f;

			check_prim(sim_add_carved(&builder, (enum solid)solid, (enum cut)cut,
						  v3(0, 0, 0), v3(0.3f, 0.3f, 0.2f), size, &paint),
				   names[cut]);
		}
	}
}

static void a_bore_lets_rays_through(void **state)
{
	const struct prim *p = sim_add_carved(&builder, SOLID_DRUM, CUT_BORE, v3(0, 0, 0),
					      v3(0.3f, 0.3f, 0.2f), 0.15f, &paint);
	struct ray down = ray_of(v3(0.05f, 0, 2), v3(0, 0, -1), 1e-3f);
	struct surface_hit hit = {.t = SIM_FAR};

	(void)state;
	assert_false(hit_field(p, &down, &hit));
	down.from.x = 0.2f;
	assert_true(hit_field(p, &down, &hit));
	assert_true(fabsf(hit.t - 1.8f) < 0.01f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(rays_find_rocks_and_landscapes, start, stop),
		cmocka_unit_test_setup_teardown(rays_find_every_carving, start, stop),
		cmocka_unit_test_setup_teardown(a_bore_lets_rays_through, start, stop),
	};

	return cmocka_run_group_tests_name("sim_shape", tests, NULL, NULL);
}
