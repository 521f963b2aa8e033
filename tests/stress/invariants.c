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
 * far from float32 as rounding puts it. The worst of seeds 1 to 100 on every tier of x86 is 54.9
 * dB; 1.5 dB are left for tiers to come. Fixed sums have no order. */
#define OTHER_SUMS_DB 53.4

static double other_sums_db(enum dvsm_precision precision)
{
	return precision == DVSM_PRECISION_FIXED ? SAME_DB : OTHER_SUMS_DB;
}

/* A world before anything changes, as each tier of a precision renders it. */
struct befores {
	enum dvsm_precision precision;
	size_t tiers;
	uint32_t masks[STRESS_TIERS];
	struct stress_outcome outcomes[STRESS_TIERS];
};

/* How far apart two pictures are, in what the precision is judged by. */
static double difference_of(enum dvsm_precision precision, const float *picture,
			    const float *before, size_t numbers)
{
	struct stress_error error = stress_compare_pictures(picture, before, numbers);

	return precision == DVSM_PRECISION_F32 ? error.largest : fmin(error.psnr_db, 200);
}

/* The picture of `world`, changed, against the one from before, the worst of all tiers: f32 to 1e-4
 * of full scale, the others to `least_db`. */
static void expect_same(const struct stress_job *job, const struct stress_world *world,
			const struct befores *befores, const char *name, double least_db)
{
	const bool absolute = befores->precision == DVSM_PRECISION_F32;
	char full_name[64];
	struct stress_figure figure = {
		.group = "invariants",
		.name = full_name,
		.precision = dvsm_precision_name(befores->precision),
		.what = absolute ? "largest difference" : "PSNR between the two, dB",
		.judgement = absolute ? STRESS_AT_MOST : STRESS_AT_LEAST,
		.limit = absolute ? 1e-4 : least_db,
		.value = absolute ? 0 : INFINITY,
	};

	snprintf(full_name, sizeof(full_name), "%s, %s", world->recipe.name, name);
	for (size_t t = 0; t < befores->tiers; t++) {
		const struct stress_way way = {befores->precision, befores->masks[t], job->threads};
		struct stress_outcome after = run_or_fault(job, world, &way, &figure);

		if (after.status != DVSM_OK)
			return;

		double difference = difference_of(befores->precision, after.picture,
						  befores->outcomes[t].picture, world->numbers);

		figure.value =
			absolute ? fmax(figure.value, difference) : fmin(figure.value, difference);
		stress_outcome_deinit(&after);
	}
	stress_report_add(job->report, &figure);
}

static void check_changes(const struct stress_job *job, struct stress_world *world,
			  const struct befores *befores)
{
	const struct dvsm_camera target = world->target;
	const uint32_t count = world->recipe.views;
	struct dvsm_view *views = support_reference_allocate(count, sizeof(*views));

	memcpy(views, world->views, count * sizeof(*views));
	for (size_t i = 0; i < COUNT(changes); i++) {
		for (uint32_t v = 0; v < count; v++)
			changes[i].apply(&world->views[v].camera, changes[i].amount);
		changes[i].apply(&world->target, changes[i].amount);
		expect_same(job, world, befores, changes[i].name, SAME_DB);
		memcpy(world->views, views, count * sizeof(*views));
		world->target = target;
	}
	free(views);
}

static void check_order(const struct stress_job *job, struct stress_world *world,
			const struct befores *befores)
{
	const uint32_t count = world->recipe.views;

	/* Back to front, then every view one further: two orders of three. */
	for (uint32_t i = 0; i < count / 2; i++) {
		struct dvsm_view swapped = world->views[i];

		world->views[i] = world->views[count - 1 - i];
		world->views[count - 1 - i] = swapped;
	}
	expect_same(job, world, befores, "views back to front", other_sums_db(befores->precision));

	struct dvsm_view first = world->views[0];

	memmove(world->views, world->views + 1, (count - 1) * sizeof(first));
	world->views[count - 1] = first;
	expect_same(job, world, befores, "views turned on", other_sums_db(befores->precision));
}

/* Every view twice: each key counts twice in numerator and denominator. */
static void check_doubled(const struct stress_job *job, struct stress_world *world,
			  const struct befores *befores)
{
	const uint32_t count = world->recipe.views;
	struct dvsm_view *once = world->views;

	world->views = support_reference_allocate(2 * (size_t)count, sizeof(*once));
	memcpy(world->views, once, count * sizeof(*once));
	memcpy(world->views + count, once, count * sizeof(*once));
	world->recipe.views = 2 * count;
	expect_same(job, world, befores, "every view twice", other_sums_db(befores->precision));
	free(world->views);
	world->views = once;
	world->recipe.views = count;
}

/* The same bits whatever the number of threads; in fixed point also whatever the tier. */
static void check_bits(const struct stress_job *job, const struct stress_world *world,
		       const struct befores *befores)
{
	const float *before = befores->outcomes[befores->tiers - 1].picture;
	const size_t tiers = befores->precision == DVSM_PRECISION_FIXED ? befores->tiers : 0;
	struct stress_figure figure = {
		.group = "invariants",
		.precision = dvsm_precision_name(befores->precision),
		.what = "numbers that differ",
		.judgement = STRESS_AT_MOST,
	};

	for (size_t i = 0; i < 4 + tiers; i++) {
		static const uint32_t threads[] = {1, 2, 3, 7};
		const struct stress_way way = {
			.precision = befores->precision,
			.threads = i < 4 ? threads[i] : 1,
			.cpu_mask = i < 4 ? 0 : befores->masks[i - 4],
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
	struct stress_recipe seeded = *recipe;
	struct befores befores = {.precision = precision};
	const struct stress_figure figure = {
		.group = "invariants",
		.name = recipe->name,
		.precision = dvsm_precision_name(precision),
		.what = "render",
	};
	bool rendered = true;

	seeded.seed = job->seed;

	struct stress_world *world = stress_world_make(&seeded);

	befores.tiers = stress_tiers(precision, befores.masks);
	for (size_t t = 0; t < befores.tiers; t++) {
		const struct stress_way way = {precision, befores.masks[t], job->threads};

		befores.outcomes[t] = run_or_fault(job, world, &way, &figure);
		rendered = rendered && befores.outcomes[t].status == DVSM_OK;
	}
	if (rendered) {
		check_bits(job, world, &befores);
		check_changes(job, world, &befores);
		check_doubled(job, world, &befores);
		check_order(job, world, &befores);
	}
	for (size_t t = 0; t < befores.tiers; t++)
		stress_outcome_deinit(&befores.outcomes[t]);
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
