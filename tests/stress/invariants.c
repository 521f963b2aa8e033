/* What may change without changing the picture. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stress/world.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* ---- changes of the whole rig, the target with it ---- */

typedef void change_fn(struct dvsm_camera *camera, double amount);

static void moved(struct dvsm_camera *camera, double amount)
{
	for (int row = 0; row < 3; row++)
		camera->world_from_camera[4 * row + 3] += amount * (row - 0.7);
}

/* About an axis that is none of the three, by `amount` radians (Rodrigues' formula). */
static void turned(struct dvsm_camera *camera, double amount)
{
	const double axis[3] = {2 / 7.0, 3 / 7.0, 6 / 7.0}, s = sin(amount), c = cos(amount);
	double *pose = camera->world_from_camera;

	for (int column = 0; column < 4; column++) {
		double v[3], along = 0;

		for (int i = 0; i < 3; i++) {
			v[i] = pose[4 * i + column];
			along += axis[i] * v[i];
		}
		for (int i = 0; i < 3; i++) {
			int j = (i + 1) % 3, k = (i + 2) % 3;

			pose[4 * i + column] = c * v[i] + s * (axis[j] * v[k] - axis[k] * v[j]) +
					       (1 - c) * along * axis[i];
		}
	}
}

static void scaled(struct dvsm_camera *camera, double amount)
{
	for (int row = 0; row < 3; row++)
		camera->world_from_camera[4 * row + 3] *= amount;
}

static void all_three(struct dvsm_camera *camera, double amount)
{
	turned(camera, amount);
	scaled(camera, 37);
	moved(camera, 1000);
}

struct change {
	const char *name;
	change_fn *apply;
	double amount;
};

static const struct change changes[] = {
	{"moved by 1", moved, 1},
	{"moved by 1000", moved, 1000},
	{"moved by 1e6", moved, 1e6},
	{"turned by 0.1", turned, 0.1},
	{"turned by 2", turned, 2},
	{"scaled by 1e-6", scaled, 1e-6},
	{"scaled by 1e-3", scaled, 1e-3},
	{"scaled by 1.7", scaled, 1.7},
	{"scaled by 1e3", scaled, 1e3},
	{"scaled by 1e6", scaled, 1e6},
	{"turned, scaled and moved", all_three, 1.3},
};

/* ---- comparing ---- */

static struct stress_outcome run_or_fault(const struct stress_job *job,
					  const struct stress_world *world,
					  const struct stress_way *way,
					  const struct stress_figure *figure)
{
	struct stress_outcome outcome = stress_world_run(world, way);

	if (outcome.status != DVSM_OK)
		stress_report_fault(job->report, figure, outcome.error.text);
	return outcome;
}

/* Of the precisions other than f32. Their own rounding makes larger errors than this; but it makes
 * the same ones both times unless a number falls on the other side of a rounding step. */
#define SAME_DB 55.0

/* Where keys come in another order or number, bf16's running maximum runs another way, weights move
 * in their last bit and many numbers fall on the other side: what is left is two pictures each as
 * far from float32 as rounding puts it, some 50 dB with drawn weights. Fixed sums have no order. */
#define OTHER_SUMS_DB 46.0

static double other_sums_db(enum dvsm_precision precision)
{
	return precision == DVSM_PRECISION_FIXED ? SAME_DB : OTHER_SUMS_DB;
}

/* The picture of `world`, changed, against the one from before: f32 to 1e-4 of full scale, the
 * others to `least_db`. */
static void expect_same(const struct stress_job *job, const struct stress_world *world,
			enum dvsm_precision precision, const char *name, double least_db,
			const float *before)
{
	const struct stress_way way = {.precision = precision, .threads = job->threads};
	char full_name[64];
	struct stress_figure figure = {
		.group = "invariants",
		.name = full_name,
		.precision = dvsm_precision_name(precision),
	};

	snprintf(full_name, sizeof(full_name), "%s, %s", world->recipe.name, name);

	struct stress_outcome after = run_or_fault(job, world, &way, &figure);

	if (after.status != DVSM_OK)
		return;

	struct stress_error error = stress_compare_pictures(after.picture, before, world->numbers);

	if (precision == DVSM_PRECISION_F32) {
		figure.what = "largest difference";
		figure.judgement = STRESS_AT_MOST;
		figure.value = error.largest;
		figure.limit = 1e-4;
	} else {
		figure.what = "PSNR between the two, dB";
		figure.judgement = STRESS_AT_LEAST;
		figure.value = fmin(error.psnr_db, 200);
		figure.limit = least_db;
	}
	stress_report_add(job->report, &figure);
	stress_outcome_deinit(&after);
}

static void check_changes(const struct stress_job *job, struct stress_world *world,
			  enum dvsm_precision precision, const float *before)
{
	const struct dvsm_camera target = world->target;
	const uint32_t count = world->recipe.views;
	struct dvsm_view *views = support_reference_allocate(count, sizeof(*views));

	memcpy(views, world->views, count * sizeof(*views));
	for (size_t i = 0; i < COUNT(changes); i++) {
		for (uint32_t v = 0; v < count; v++)
			changes[i].apply(&world->views[v].camera, changes[i].amount);
		changes[i].apply(&world->target, changes[i].amount);
		expect_same(job, world, precision, changes[i].name, SAME_DB, before);
		memcpy(world->views, views, count * sizeof(*views));
		world->target = target;
	}
	free(views);
}

static void check_order(const struct stress_job *job, struct stress_world *world,
			enum dvsm_precision precision, const float *before)
{
	const uint32_t count = world->recipe.views;

	/* Back to front, then every view one further: two orders of three. */
	for (uint32_t i = 0; i < count / 2; i++) {
		struct dvsm_view swapped = world->views[i];

		world->views[i] = world->views[count - 1 - i];
		world->views[count - 1 - i] = swapped;
	}
	expect_same(job, world, precision, "views back to front", other_sums_db(precision), before);

	struct dvsm_view first = world->views[0];

	memmove(world->views, world->views + 1, (count - 1) * sizeof(first));
	world->views[count - 1] = first;
	expect_same(job, world, precision, "views turned on", other_sums_db(precision), before);
}

/* Every view twice: each key counts twice in numerator and denominator. */
static void check_doubled(const struct stress_job *job, struct stress_world *world,
			  enum dvsm_precision precision, const float *before)
{
	const uint32_t count = world->recipe.views;
	struct dvsm_view *once = world->views;

	world->views = support_reference_allocate(2 * (size_t)count, sizeof(*once));
	memcpy(world->views, once, count * sizeof(*once));
	memcpy(world->views + count, once, count * sizeof(*once));
	world->recipe.views = 2 * count;
	expect_same(job, world, precision, "every view twice", other_sums_db(precision), before);
	free(world->views);
	world->views = once;
	world->recipe.views = count;
}

/* The same bits whatever the number of threads; in fixed point also whatever the tier. */
static void check_bits(const struct stress_job *job, const struct stress_world *world,
		       enum dvsm_precision precision, const float *before)
{
	struct stress_figure figure = {
		.group = "invariants",
		.precision = dvsm_precision_name(precision),
		.what = "numbers that differ",
		.judgement = STRESS_AT_MOST,
	};
	uint32_t masks[STRESS_TIERS];
	size_t tiers = precision == DVSM_PRECISION_FIXED ? stress_tiers(precision, masks) : 0;

	for (size_t i = 0; i < 4 + tiers; i++) {
		static const uint32_t threads[] = {1, 2, 3, 7};
		const struct stress_way way = {
			.precision = precision,
			.threads = i < 4 ? threads[i] : 1,
			.cpu_mask = i < 4 ? 0 : masks[i - 4],
		};
		char name[48];

		if (i < 4)
			snprintf(name, sizeof(name), "%s, %u threads", world->recipe.name,
				 way.threads);
		else
			snprintf(name, sizeof(name), "%s, tier %s", world->recipe.name,
				 dvsm_cpu_name(way.cpu_mask));
		figure.name = name;
		figure.value = 0;

		struct stress_outcome after = run_or_fault(job, world, &way, &figure);

		for (size_t n = 0; after.picture && n < world->numbers; n++)
			figure.value += memcmp(&after.picture[n], &before[n], sizeof(float)) != 0;
		if (after.picture)
			stress_report_add(job->report, &figure);
		stress_outcome_deinit(&after);
	}
}

static void check_all(const struct stress_job *job, const struct stress_recipe *recipe,
		      enum dvsm_precision precision)
{
	struct stress_world *world = stress_world_make(recipe);
	const struct stress_way way = {.precision = precision, .threads = job->threads};
	const struct stress_figure figure = {
		.group = "invariants",
		.name = recipe->name,
		.precision = dvsm_precision_name(precision),
		.what = "render",
	};
	struct stress_outcome before = run_or_fault(job, world, &way, &figure);

	if (before.status == DVSM_OK) {
		check_bits(job, world, precision, before.picture);
		check_changes(job, world, precision, before.picture);
		check_doubled(job, world, precision, before.picture);
		check_order(job, world, precision, before.picture);
	}
	stress_outcome_deinit(&before);
	stress_world_free(world);
}

void stress_invariants(const struct stress_job *job)
{
	/* Five views, so that no sum is exact by luck. */
	struct stress_recipe recipe = stress_recipe_base;

	recipe.views = 5;
	for (size_t p = 0; p < job->precision_count; p++) {
		check_all(job, &recipe, job->precisions[p]);
		if (!job->quick)
			check_all(job, &stress_recipe_shipped, job->precisions[p]);
	}
}
