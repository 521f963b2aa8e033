/* Weights, pictures, poses and rigs that no one trains or photographs, against the reference. */
#include <math.h>
#include <stdio.h>

#include "stress/rigs.h"
#include "stress/world.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

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
		2e-6, 2e-2, 3e-2                                                                   \
	}

/* Three channels decide all there is. Fixed keeps them turned, spread over many numbers of int8
 * where three would do: sqrt(3) times the error (engine/FIXED_POINT.md, section 2). How much that
 * comes to is up to the weights: 0.004 to 0.33 in a hundred draws, f32's error along with it. This
 * is for the draw of seed 1, 0.0425 on every tier. */
#define LIMITS_FEW_CHANNELS                                                                        \
	{                                                                                          \
		2e-6, 2e-2, 4.7e-2                                                                 \
	}

/* Rays that are all but parallel: tokens are alike, a product's sum rounds the same way in each of
 * them and nothing averages. The shipped model's f32 comes to 6.5e-6 at worst, of 40 focal lengths
 * on every tier. */
#define LIMITS_ALIKE                                                                               \
	{                                                                                          \
		1e-5, 2e-2, 3e-2                                                                   \
	}

/* Colours of thousands, of which only those below 100 count: small ones beside large ones. */
#define LIMITS_BRIGHT                                                                              \
	{                                                                                          \
		1e-5, 1e-1, 3e-1                                                                   \
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
	const struct dvsm_model_config *config; /* NULL: as in the base */
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
#define SHAPE(text, sizes, patch, ...)                                                             \
	{                                                                                          \
		.name = (text), .config = &(sizes), .patch_px = (patch), .limits = __VA_ARGS__     \
	}
#define PICTURES(text, what, ...)                                                                  \
	{                                                                                          \
		.name = (text), .picture = (what), .limits = __VA_ARGS__                           \
	}

/* Sizes that no tile and no vector fits: dim, heads, layers, patch, mlp_ratio, prior, epsilon. */
static const struct dvsm_model_config shape_1 = {1, 1, 2, 4, 1, 0, 1e-6, false};
static const struct dvsm_model_config shape_heads_of_1 = {6, 6, 2, 4, 2, 0, 1e-6, false};
static const struct dvsm_model_config shape_33 = {33, 3, 2, 5, 3, 0, 1e-6, false};
static const struct dvsm_model_config shape_one_head = {257, 1, 2, 8, 1, 0, 1e-6, false};
static const struct dvsm_model_config shape_wide_mlp = {48, 3, 2, 8, 64, 0, 1e-6, false};
static const struct dvsm_model_config shape_patch_1 = {64, 2, 2, 1, 4, 0, 1e-6, false};
static const struct dvsm_model_config shape_patch_64 = {64, 2, 1, 64, 4, 0, 1e-6, false};
static const struct dvsm_model_config shape_sigmoid = {64, 2, 3, 8, 4, 0, 1e-6, true};
static const struct dvsm_model_config shape_small_epsilon = {64, 2, 3, 8, 4, 0, 1e-30, false};
static const struct dvsm_model_config shape_large_epsilon = {64, 2, 3, 8, 4, 0, 0.1, false};

static const struct extreme extremes[] = {
	WEIGHTS("plain", NULL, 0, LIMITS_USUAL),
	WEIGHTS("outlier channels x100", stress_twist_outlier_channels, 100, LIMITS_FEW_CHANNELS),
	WEIGHTS("outlier channels x1e4", stress_twist_outlier_channels, 1e4, LIMITS_FEW_CHANNELS),
	WEIGHTS("outlier values x100", stress_twist_outlier_values, 100, LIMITS_USUAL),
	WEIGHTS("norms x1e-4", stress_twist_norms, 1e-4, LIMITS_USUAL),
	WEIGHTS("norms x1e-12", stress_twist_norms, 1e-12, LIMITS_USUAL),
	WEIGHTS("norms x1e4", stress_twist_norms, 1e4, LIMITS_BRIGHT),
	WEIGHTS("norms x1e-3 to x1e3", stress_twist_uneven_norms, 1e3, LIMITS_USUAL),
	WEIGHTS("scores to 10", stress_twist_scores, 10, LIMITS_USUAL),
	WEIGHTS("scores to 100", stress_twist_scores, 100, {5e-5, 0.5, 0.5}),
	WEIGHTS("scores to 1000", stress_twist_scores, 1000, {5e-3, 1, 1}),
	WEIGHTS("scores to 1e6", stress_twist_scores, 1e6, {2e-6, 1, 1}),
	WEIGHTS("keys alike to 1e-2", stress_twist_equal_keys, 1e2, LIMITS_USUAL),
	WEIGHTS("keys alike to 1e-4", stress_twist_equal_keys, 1e4, LIMITS_USUAL),
	WEIGHTS("keys of size 1e-3", stress_twist_tiny_keys, 1e3, LIMITS_USUAL),
	WEIGHTS("keys of size 1e-9", stress_twist_tiny_keys, 1e9, LIMITS_USUAL),
	WEIGHTS("matrices x1e-3", stress_twist_matrices, 1e-3, LIMITS_USUAL),
	WEIGHTS("matrices x1e3", stress_twist_matrices, 1e3, LIMITS_BRIGHT),
	WEIGHTS("all weights 0", stress_twist_zero, 0, LIMITS_USUAL),
	PICTURES("noise", STRESS_NOISE, LIMITS_USUAL),
	PICTURES("all black", STRESS_BLACK, LIMITS_USUAL),
	PICTURES("all white", STRESS_WHITE, LIMITS_USUAL),
	PICTURES("all grey", STRESS_GREY, LIMITS_USUAL),
	PICTURES("all -1", STRESS_LOWEST, LIMITS_USUAL),
	PICTURES("all 2", STRESS_HIGHEST, LIMITS_USUAL),
	PICTURES("speckled", STRESS_SPECKLED, LIMITS_USUAL),
	PICTURES("all equal", STRESS_EQUAL, LIMITS_USUAL),
	RIG("rig 1e6 away", stress_rig_far_away, 1e6, LIMITS_USUAL),
	RIG("target 1e3 rigs away", stress_rig_far_target, 1e3, LIMITS_USUAL),
	RIG("target 1e6 rigs away", stress_rig_far_target, 1e6, LIMITS_USUAL),
	RIG("target 1e8 rigs away", stress_rig_far_target, 1e8, LIMITS_USUAL),
	RIG("rig x1e-6", stress_rig_scaled, 1e-6, LIMITS_USUAL),
	RIG("rig x1e6", stress_rig_scaled, 1e6, LIMITS_USUAL),
	RIG("cameras at one place", stress_rig_one_place, 0, LIMITS_USUAL),
	RIG("cameras at one place, 1e8 away", stress_rig_one_far_place, 1.1e8, LIMITS_USUAL),
	RIG("cameras 4e-10 apart", stress_rig_one_place, 4e-10, LIMITS_USUAL),
	RIG("cameras 4e-9 apart", stress_rig_one_place, 4e-9, LIMITS_USUAL),
	RIG("one camera thrice", stress_rig_one_camera, 0, LIMITS_USUAL),
	RIG("bent rotations", stress_rig_bent, 4e-4, LIMITS_USUAL),
	RIG("focal length 1e5 widths", stress_rig_long_lens, 1e5, LIMITS_ALIKE),
	RIG("focal length 1e-5 widths", stress_rig_long_lens, 1e-5, LIMITS_USUAL),
	RIG("principal point 1e5 widths off", stress_rig_shifted_lens, 1e5, LIMITS_USUAL),
	RIG("slivers", stress_rig_slivers, 0, LIMITS_USUAL),
	{.name = "mean axis 1e-3",
	 .rig = stress_rig_back_to_back,
	 .rig_amount = 2e-3,
	 .views = 4,
	 .limits = LIMITS_USUAL},
	{.name = "mean axis 1e-5",
	 .rig = stress_rig_back_to_back,
	 .rig_amount = 2e-5,
	 .views = 4,
	 .limits = LIMITS_USUAL},
	{.name = "mean axis 0",
	 .rig = stress_rig_back_to_back,
	 .rig_amount = 0,
	 .views = 4,
	 .limits = LIMITS_USUAL},
	{.name = "mean y along mean z, 1e-4",
	 .rig = stress_rig_crossed,
	 .rig_amount = 1e-4,
	 .views = 2,
	 .limits = LIMITS_USUAL},
	{.name = "mean y along mean z",
	 .rig = stress_rig_crossed,
	 .rig_amount = 0,
	 .views = 2,
	 .limits = LIMITS_USUAL},
	SHAPE("dim 1", shape_1, 8, LIMITS_USUAL),
	SHAPE("heads of 1", shape_heads_of_1, 8, LIMITS_USUAL),
	SHAPE("dim 33, patch 5", shape_33, 8, LIMITS_USUAL),
	SHAPE("dim 257, one head", shape_one_head, 0, LIMITS_USUAL),
	SHAPE("mlp_ratio 64", shape_wide_mlp, 0, LIMITS_USUAL),
	SHAPE("patch 1", shape_patch_1, 8, LIMITS_USUAL),
	SHAPE("patch 64", shape_patch_64, 8, LIMITS_USUAL),
	SHAPE("sigmoid", shape_sigmoid, 0, LIMITS_USUAL),
	SHAPE("epsilon 1e-30", shape_small_epsilon, 0, LIMITS_USUAL),
	SHAPE("epsilon 0.1", shape_large_epsilon, 0, LIMITS_USUAL),
	{.name = "one view", .views = 1, .limits = LIMITS_USUAL},
	{.name = "one token a view", .views = 2, .patch_px = 256, .limits = LIMITS_USUAL},
	{.name = "stage patch 3", .views = 2, .patch_px = 3, .limits = LIMITS_USUAL},
};

static struct stress_recipe recipe_of(const struct extreme *extreme,
				      const struct stress_recipe *base)
{
	struct stress_recipe recipe = *base;

	recipe.name = extreme->name;
	recipe.config = extreme->config ? *extreme->config : recipe.config;
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

		if (outcome.status == DVSM_UNSUPPORTED) {
			/* Integers that cannot hold a model say so when an engine is made. */
			figure.what = "refused";
			figure.judgement = STRESS_STATED;
			figure.value = 1;
			stress_report_add(job->report, &figure);
			return;
		}
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
	recipe.seed = job->seed;

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

/* Numbers of a world's picture that are not finite, over all tiers; all of them after a failure,
 * but none where a precision says that it cannot hold the model. */
static size_t count_not_finite(const struct stress_job *job, const struct stress_world *world,
			       enum dvsm_precision precision)
{
	uint32_t masks[STRESS_TIERS];
	size_t tiers = stress_tiers(precision, masks), count = 0;

	for (size_t t = 0; t < tiers; t++) {
		const struct stress_way way = {precision, masks[t], job->threads};
		struct stress_outcome outcome = stress_world_run(world, &way);

		for (size_t i = 0; outcome.status != DVSM_UNSUPPORTED && i < world->numbers; i++)
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
	recipe.seed = job->seed;
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
		if (!job->quick && !extremes[i].twist && !extremes[i].config)
			check_extreme(job, &extremes[i], &stress_recipe_shipped);
	}
}
