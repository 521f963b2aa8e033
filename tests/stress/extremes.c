/* Weights, pictures, poses and rigs that no one trains or photographs, against the reference. */
#include <math.h>
#include <stdio.h>

#include "stress/world.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* ---- rigs ---- */

/* The rig and its target by `amount` in all directions. */
static void move(struct dvsm_camera *camera, double amount)
{
	for (int row = 0; row < 3; row++)
		camera->world_from_camera[4 * row + 3] += amount * (row + 1);
}

static void rig_far_away(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			 double amount)
{
	for (uint32_t v = 0; v < count; v++)
		move(&views[v].camera, amount);
	move(target, amount);
}

static void rig_far_target(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			   double amount)
{
	(void)views;
	(void)count;
	move(target, amount);
}

static void scale(struct dvsm_camera *camera, double amount)
{
	for (int row = 0; row < 3; row++)
		camera->world_from_camera[4 * row + 3] *= amount;
}

static void rig_scaled(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
		       double amount)
{
	for (uint32_t v = 0; v < count; v++)
		scale(&views[v].camera, amount);
	scale(target, amount);
}

/* All context cameras at one place, `amount` apart. */
static void rig_one_place(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			  double amount)
{
	(void)target;
	for (uint32_t v = 0; v < count; v++) {
		for (int row = 0; row < 3; row++)
			views[v].camera.world_from_camera[4 * row + 3] = 1 + amount * v * row;
	}
}

static void rig_one_far_place(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			      double amount)
{
	rig_one_place(views, count, target, 0);
	rig_far_away(views, count, target, amount);
}

/* One camera over and over. */
static void rig_one_camera(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			   double amount)
{
	(void)target;
	(void)amount;
	for (uint32_t v = 1; v < count; v++)
		views[v].camera = views[0].camera;
}

/* Every camera turned about an axis of its own: 0 is x, 1 is y, 2 is z. */
static void turn(struct dvsm_camera *camera, int axis, double angle)
{
	const int a = (axis + 1) % 3, b = (axis + 2) % 3;
	double *pose = camera->world_from_camera, s = sin(angle), c = cos(angle);

	for (int row = 0; row < 3; row++) {
		double u = pose[4 * row + a], v = pose[4 * row + b];

		pose[4 * row + a] = c * u + s * v;
		pose[4 * row + b] = c * v - s * u;
	}
}

/* Two cameras that look away from one another but for `amount`: the mean direction all but
 * vanishes. */
static void rig_back_to_back(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			     double amount)
{
	(void)target;
	for (uint32_t v = 1; v < count; v++) {
		double *centre = views[v].camera.world_from_camera;
		const double kept[3] = {centre[3], centre[7], centre[11]};

		views[v].camera = views[0].camera;
		for (int row = 0; row < 3; row++)
			centre[4 * row + 3] = kept[row];
		turn(&views[v].camera, 1, v % 2 ? M_PI - amount : 0);
	}
}

/* Cameras that look down along their mean y axis but for `amount`: x has hardly a direction. */
static void rig_crossed(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			double amount)
{
	(void)target;
	for (uint32_t v = 0; v < count; v++) {
		double *pose = views[v].camera.world_from_camera;
		const double s = sin(amount * (v + 1)), c = cos(amount * (v + 1));
		/* By turns y and z, z and y, so that both means point the same way. */
		const double even[9] = {c, 0, s, -s, 0, c, 0, -1, 0};
		const double odd[9] = {-c, s, 0, s, c, 0, 0, 0, -1};

		for (int i = 0; i < 9; i++)
			pose[4 * (i / 3) + i % 3] = v % 2 ? odd[i] : even[i];
	}
}

/* As far off a rotation as the engine takes. */
static void rig_bent(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
		     double amount)
{
	(void)target;
	for (uint32_t v = 0; v < count; v++)
		views[v].camera.world_from_camera[0] += v % 2 ? amount : -amount;
}

static void rig_long_lens(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			  double amount)
{
	for (uint32_t v = 0; v < count; v++)
		views[v].camera.fx = views[v].camera.fy = amount * views[v].camera.width;
	target->fx = target->fy = amount * target->width;
}

static void rig_shifted_lens(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			     double amount)
{
	for (uint32_t v = 0; v < count; v++)
		views[v].camera.cx = amount * views[v].camera.width;
	target->cy = -amount * target->height;
}

/* Pictures of very different sizes: 1 x 1, one row, one column. */
static void rig_slivers(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			double amount)
{
	(void)amount;
	for (uint32_t v = 0; v < count; v++) {
		views[v].camera.width = v % 2 ? 1 : 61;
		views[v].camera.height = v % 3 ? 1 : 37;
	}
	target->width = 1;
	target->height = 53;
}

/* ---- the cases ---- */

/*
 * Most relative error of each precision; 0 where a number only has to be finite. Where the scores
 * decide between few keys, an error of a score in its last place is an error of a weight: there it
 * grows with the score.
 */
struct limits {
	double f32, bf16, fixed;
};

#define LIMITS_USUAL                                                                               \
	{                                                                                          \
		2e-6, 2e-2, 5e-2                                                                   \
	}

struct extreme {
	const char *name;
	stress_twist_fn *twist;
	double twist_amount;
	stress_rig_fn *rig;
	double rig_amount;
	enum stress_picture picture;
	uint32_t views; /* 0: as in the base */
	uint32_t patch_px;
	struct limits limits;
};

#define WEIGHTS(text, function, amount, ...)                                                       \
	{                                                                                          \
		.name = (text), .twist = (function), .twist_amount = (amount),                     \
		.limits = __VA_ARGS__                                                              \
	}
#define RIG(text, function, amount, ...)                                                           \
	{                                                                                          \
		.name = (text), .rig = (function), .rig_amount = (amount), .limits = __VA_ARGS__   \
	}
#define PICTURES(text, what, ...)                                                                  \
	{                                                                                          \
		.name = (text), .picture = (what), .limits = __VA_ARGS__                           \
	}

static const struct extreme extremes[] = {
	WEIGHTS("plain", NULL, 0, LIMITS_USUAL),
	WEIGHTS("outlier channels x100", stress_twist_outlier_channels, 100, LIMITS_USUAL),
	WEIGHTS("outlier channels x1e4", stress_twist_outlier_channels, 1e4, LIMITS_USUAL),
	WEIGHTS("outlier values x100", stress_twist_outlier_values, 100, LIMITS_USUAL),
	WEIGHTS("norms x1e-4", stress_twist_norms, 1e-4, LIMITS_USUAL),
	WEIGHTS("norms x1e-12", stress_twist_norms, 1e-12, LIMITS_USUAL),
	WEIGHTS("norms x1e4", stress_twist_norms, 1e4, LIMITS_USUAL),
	WEIGHTS("norms x1e-3 to x1e3", stress_twist_uneven_norms, 1e3, LIMITS_USUAL),
	WEIGHTS("scores to 10", stress_twist_scores, 10, LIMITS_USUAL),
	WEIGHTS("scores to 100", stress_twist_scores, 100, {5e-5, 0.5, 0.5}),
	WEIGHTS("scores to 1000", stress_twist_scores, 1000, {5e-3, 1, 1}),
	WEIGHTS("scores to 1e6", stress_twist_scores, 1e6, LIMITS_USUAL),
	WEIGHTS("keys alike to 1e-2", stress_twist_equal_keys, 1e2, LIMITS_USUAL),
	WEIGHTS("keys alike to 1e-4", stress_twist_equal_keys, 1e4, LIMITS_USUAL),
	WEIGHTS("keys of size 1e-3", stress_twist_tiny_keys, 1e3, LIMITS_USUAL),
	WEIGHTS("keys of size 1e-9", stress_twist_tiny_keys, 1e9, LIMITS_USUAL),
	WEIGHTS("matrices x1e-3", stress_twist_matrices, 1e-3, LIMITS_USUAL),
	WEIGHTS("matrices x1e3", stress_twist_matrices, 1e3, LIMITS_USUAL),
	WEIGHTS("all weights 0", stress_twist_zero, 0, LIMITS_USUAL),
	PICTURES("noise", STRESS_NOISE, LIMITS_USUAL),
	PICTURES("all black", STRESS_BLACK, LIMITS_USUAL),
	PICTURES("all white", STRESS_WHITE, LIMITS_USUAL),
	PICTURES("all grey", STRESS_GREY, LIMITS_USUAL),
	PICTURES("all -1", STRESS_LOWEST, LIMITS_USUAL),
	PICTURES("all 2", STRESS_HIGHEST, LIMITS_USUAL),
	PICTURES("speckled", STRESS_SPECKLED, LIMITS_USUAL),
	PICTURES("all equal", STRESS_EQUAL, LIMITS_USUAL),
	RIG("rig 1e6 away", rig_far_away, 1e6, LIMITS_USUAL),
	RIG("target 1e3 rigs away", rig_far_target, 1e3, LIMITS_USUAL),
	RIG("target 1e6 rigs away", rig_far_target, 1e6, LIMITS_USUAL),
	RIG("target 1e8 rigs away", rig_far_target, 1e8, LIMITS_USUAL),
	RIG("rig x1e-6", rig_scaled, 1e-6, LIMITS_USUAL),
	RIG("rig x1e6", rig_scaled, 1e6, LIMITS_USUAL),
	RIG("cameras at one place", rig_one_place, 0, LIMITS_USUAL),
	RIG("cameras at one place, 1e8 away", rig_one_far_place, 1.1e8, LIMITS_USUAL),
	RIG("cameras 4e-10 apart", rig_one_place, 4e-10, LIMITS_USUAL),
	RIG("cameras 4e-9 apart", rig_one_place, 4e-9, LIMITS_USUAL),
	RIG("one camera thrice", rig_one_camera, 0, LIMITS_USUAL),
	RIG("bent rotations", rig_bent, 4e-4, LIMITS_USUAL),
	RIG("focal length 1e5 widths", rig_long_lens, 1e5, LIMITS_USUAL),
	RIG("focal length 1e-5 widths", rig_long_lens, 1e-5, LIMITS_USUAL),
	RIG("principal point 1e5 widths off", rig_shifted_lens, 1e5, LIMITS_USUAL),
	RIG("slivers", rig_slivers, 0, LIMITS_USUAL),
	{.name = "mean axis 1e-3",
	 .rig = rig_back_to_back,
	 .rig_amount = 2e-3,
	 .views = 4,
	 .limits = LIMITS_USUAL},
	{.name = "mean axis 1e-5",
	 .rig = rig_back_to_back,
	 .rig_amount = 2e-5,
	 .views = 4,
	 .limits = LIMITS_USUAL},
	{.name = "mean axis 0",
	 .rig = rig_back_to_back,
	 .rig_amount = 0,
	 .views = 4,
	 .limits = LIMITS_USUAL},
	{.name = "mean y along mean z, 1e-4",
	 .rig = rig_crossed,
	 .rig_amount = 1e-4,
	 .views = 2,
	 .limits = LIMITS_USUAL},
	{.name = "mean y along mean z",
	 .rig = rig_crossed,
	 .rig_amount = 0,
	 .views = 2,
	 .limits = LIMITS_USUAL},
	{.name = "one view", .views = 1, .limits = LIMITS_USUAL},
	{.name = "one token a view", .views = 2, .patch_px = 256, .limits = LIMITS_USUAL},
	{.name = "patch 1", .views = 2, .patch_px = 3, .limits = LIMITS_USUAL},
};

static struct stress_recipe recipe_of(const struct extreme *extreme,
				      const struct stress_recipe *base)
{
	struct stress_recipe recipe = *base;

	recipe.name = extreme->name;
	recipe.twist = extreme->twist;
	recipe.twist_amount = extreme->twist_amount;
	recipe.rig = extreme->rig;
	recipe.rig_amount = extreme->rig_amount;
	recipe.picture = extreme->picture;
	recipe.views = extreme->views ? extreme->views : recipe.views;
	recipe.patch_px = extreme->patch_px ? extreme->patch_px : recipe.patch_px;
	return recipe;
}

static double limit_of(const struct limits *limits, enum dvsm_precision precision)
{
	switch (precision) {
	case DVSM_PRECISION_F32:
		return limits->f32;
	case DVSM_PRECISION_BF16:
		return limits->bf16;
	case DVSM_PRECISION_FIXED:
		return limits->fixed;
	}
	return 0;
}

/* One case in one precision, on every tier: the worst of them. */
static void check(const struct stress_job *job, struct stress_world *world,
		  enum dvsm_precision precision, double limit)
{
	struct stress_figure figure = {
		.group = "extremes",
		.name = world->recipe.name,
		.precision = dvsm_precision_name(precision),
		.what = "relative error",
		.judgement = STRESS_AT_MOST,
		.limit = limit,
	};
	const double *expected = stress_world_expect(world);
	uint32_t masks[STRESS_TIERS];
	size_t tiers = stress_tiers(precision, masks);
	uint64_t saturated = 0;

	for (size_t t = 0; t < tiers; t++) {
		const struct stress_way way = {precision, masks[t], job->threads};
		struct stress_outcome outcome = stress_world_run(world, &way);

		if (outcome.status != DVSM_OK) {
			stress_report_fault(job->report, &figure, outcome.error.text);
			return;
		}

		struct stress_error error =
			stress_compare(outcome.picture, expected, world->numbers);

		figure.value = fmax(figure.value, error.relative);
		saturated = outcome.saturated > saturated ? outcome.saturated : saturated;
		stress_outcome_deinit(&outcome);
	}
	stress_report_add(job->report, &figure);
	if (precision == DVSM_PRECISION_FIXED) {
		figure.what = "numbers clamped";
		figure.judgement = STRESS_STATED;
		figure.value = (double)saturated;
		stress_report_add(job->report, &figure);
	}
}

static void state_range(const struct stress_job *job, const struct stress_world *world)
{
	const struct support_reference_range *range = support_reference_get_range(world->reference);
	struct stress_figure figure = {
		.group = "extremes",
		.name = world->recipe.name,
		.precision = "f64",
		.what = "largest score",
		.judgement = STRESS_STATED,
		.value = range->score,
	};

	stress_report_add(job->report, &figure);
	figure.what = "largest residual";
	figure.value = range->residual;
	stress_report_add(job->report, &figure);
}

static void check_extreme(const struct stress_job *job, const struct extreme *extreme,
			  const struct stress_recipe *base)
{
	struct stress_recipe recipe = recipe_of(extreme, base);
	char name[64];

	snprintf(name, sizeof(name), "%s%s", base->model_path ? "shipped, " : "", extreme->name);
	recipe.name = name;

	struct stress_world *world = stress_world_make(&recipe);

	stress_world_expect(world);
	if (recipe.twist)
		state_range(job, world);
	for (size_t p = 0; p < job->precision_count; p++)
		check(job, world, job->precisions[p],
		      limit_of(&extreme->limits, job->precisions[p]));
	stress_world_free(world);
}

/* ---- weights towards the end of float's range ---- */

struct ladder {
	const char *name;
	stress_twist_fn *twist;
};

static const struct ladder ladders[] = {
	{"matrices, to 1e36", stress_twist_matrices},
	{"norms, to 1e36", stress_twist_norms},
	{"outlier channels, to 1e36", stress_twist_outlier_channels},
	{"outlier values, to 1e36", stress_twist_outlier_values},
	{"scores, to 1e36", stress_twist_scores},
};

/* Numbers of a world's picture that are not finite, over all tiers; all when it is refused. */
static size_t count_not_finite(const struct stress_job *job, const struct stress_world *world,
			       enum dvsm_precision precision)
{
	uint32_t masks[STRESS_TIERS];
	size_t tiers = stress_tiers(precision, masks), count = 0;

	for (size_t t = 0; t < tiers; t++) {
		const struct stress_way way = {precision, masks[t], job->threads};
		struct stress_outcome outcome = stress_world_run(world, &way);

		for (size_t i = 0; i < world->numbers; i++)
			count += !outcome.picture || !isfinite(outcome.picture[i]);
		stress_outcome_deinit(&outcome);
	}
	return count;
}

/* Weights ever larger, by powers of ten: a model that opens renders finite numbers. */
static void climb(const struct stress_job *job, const struct ladder *ladder,
		  enum dvsm_precision precision)
{
	struct stress_recipe recipe = stress_recipe_base;
	struct stress_figure figure = {
		.group = "extremes",
		.name = ladder->name,
		.precision = dvsm_precision_name(precision),
		.what = "numbers not finite",
		.judgement = STRESS_AT_MOST,
	};
	double highest = 0;

	recipe.name = ladder->name;
	recipe.twist = ladder->twist;
	for (double power = 0; power <= 36; power += job->quick ? 4 : 1) {
		recipe.twist_amount = pow(10, power);

		struct dvsm_error error;
		struct stress_world *world = stress_world_try(&recipe, &error);

		if (!world)
			continue;
		highest = power;
		figure.value += (double)count_not_finite(job, world, precision);
		stress_world_free(world);
	}
	stress_report_add(job->report, &figure);
	figure.what = "power of ten that still opens";
	figure.judgement = STRESS_STATED;
	figure.value = highest;
	stress_report_add(job->report, &figure);
}

void stress_extremes(const struct stress_job *job)
{
	for (size_t i = 0; i < COUNT(ladders); i++) {
		for (size_t p = 0; p < job->precision_count; p++)
			climb(job, &ladders[i], job->precisions[p]);
	}

	for (size_t i = 0; i < COUNT(extremes); i++) {
		check_extreme(job, &extremes[i], &stress_recipe_base);
		/* Its weights are what they are; a minute has no room for it. */
		if (!job->quick && !extremes[i].twist)
			check_extreme(job, &extremes[i], &stress_recipe_shipped);
	}
}
