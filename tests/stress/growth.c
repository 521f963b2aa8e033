/* How the error against the reference grows with depth, keys and magnitude. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "stress/plot.h"
#include "stress/world.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

/*
 * A line of worlds along one quantity.
 *
 * set    makes the base recipe one of this line
 * most   relative error of each precision at the far end (f32, bf16, fixed); rounding errors
 *        neither cancel nor pile up by chance over three blocks of random weights
 */
struct line {
	const char *name, *title, *x_title;
	void (*set)(struct stress_recipe *recipe, double x);
	const double *steps;
	size_t count, quick; /* how many of the steps */
	double most[STRESS_PRECISIONS];
};

static void set_depth(struct stress_recipe *recipe, double x)
{
	recipe->config.layers = (uint32_t)x;
}

static void set_views(struct stress_recipe *recipe, double x)
{
	recipe->views = (uint32_t)x;
}

/* One block, so that reconstruction has no attention across all keys: only rendering has. Views of
 * 1 to 512 tokens. */
static void set_keys(struct stress_recipe *recipe, double x)
{
	uint32_t tokens = x < 512 ? (uint32_t)x : 512;

	recipe->config.layers = 1;
	recipe->views = (uint32_t)x / tokens;
	recipe->width = 8 * tokens;
	recipe->height = 8;
	while (recipe->width > 2 * recipe->height && recipe->width % 16 == 0) {
		recipe->width /= 2;
		recipe->height *= 2;
	}
}

static void set_scores(struct stress_recipe *recipe, double x)
{
	recipe->twist = stress_twist_scores;
	recipe->twist_amount = x;
}

static void set_outliers(struct stress_recipe *recipe, double x)
{
	recipe->twist = stress_twist_outlier_channels;
	recipe->twist_amount = x;
}

static void set_equal_keys(struct stress_recipe *recipe, double x)
{
	recipe->twist = stress_twist_equal_keys;
	recipe->twist_amount = x;
}

static const double depths[] = {1, 2, 4, 8, 16, 32};
static const double view_counts[] = {1, 2, 4, 8, 16, 32, 64, 128};
static const double key_counts[] = {1, 4, 16, 64, 256, 1024, 4096, 16384, 65536};
static const double powers[] = {1, 3, 10, 30, 100, 300, 1000, 3000, 10000};

#define STEPS(array, quick) array, COUNT(array), quick

static const struct line lines[] = {
	{"depth", "depth", "blocks", set_depth, STEPS(depths, 4), {1e-5, 2e-2, 5e-2}},
	{"views",
	 "context views (36 tokens each)",
	 "views",
	 set_views,
	 STEPS(view_counts, 5),
	 {1e-5, 2e-2, 5e-2}},
	{"keys", "keys of one block", "keys", set_keys, STEPS(key_counts, 7), {1e-5, 2e-2, 5e-2}},
	{"scores",
	 "attention scores",
	 "largest score that q and k could reach",
	 set_scores,
	 STEPS(powers, 7),
	 {1e-2, 2, 2}},
	{"outliers",
	 "outlier channels",
	 "times as large as the other channels",
	 set_outliers,
	 STEPS(powers, 5),
	 {1e-5, 5e-2, 1e-1}},
	{"alike",
	 "keys that are alike",
	 "common part over what differs",
	 set_equal_keys,
	 STEPS(powers, 5),
	 {1e-5, 2e-2, 5e-2}},
};

#define LINES COUNT(lines)

/* One world of a line in one precision. */
static void measure(const struct stress_job *job, const struct line *line,
		    struct stress_world *world, enum dvsm_precision precision, double x,
		    struct stress_plot *plot)
{
	const struct stress_way way = {.precision = precision, .threads = job->threads};
	struct stress_figure figure = {
		.group = "growth",
		.name = world->recipe.name,
		.precision = dvsm_precision_name(precision),
		.what = "relative error",
		.judgement = STRESS_AT_MOST,
		.limit = line->most[precision],
	};
	struct stress_outcome outcome = stress_world_run(world, &way);

	if (outcome.status != DVSM_OK) {
		stress_report_fault(job->report, &figure, outcome.error.text);
		return;
	}

	struct stress_error error =
		stress_compare(outcome.picture, stress_world_expect(world), world->numbers);

	figure.value = error.relative;
	stress_report_add(job->report, &figure);
	if (error.relative > 0 && isfinite(error.relative))
		stress_curve_add(stress_plot_curve(plot, figure.precision), x, error.relative);
	stress_outcome_deinit(&outcome);
}

static void walk(const struct stress_job *job, const struct line *line, struct stress_plot *plot)
{
	plot->title = line->title;
	plot->x_title = line->x_title;
	plot->y_title = "relative error";
	for (size_t i = 0; i < (job->quick ? line->quick : line->count); i++) {
		struct stress_recipe recipe = stress_recipe_base;
		char name[48];

		snprintf(name, sizeof(name), "%s %g", line->name, line->steps[i]);
		recipe.name = name;
		recipe.seed = job->seed;
		line->set(&recipe, line->steps[i]);

		struct stress_world *world = stress_world_make(&recipe);

		for (size_t p = 0; p < job->precision_count; p++)
			measure(job, line, world, job->precisions[p], line->steps[i], plot);
		stress_world_free(world);
	}
}

void stress_growth(const struct stress_job *job)
{
	static struct stress_plot plots[LINES];

	for (size_t i = 0; i < LINES; i++)
		walk(job, &lines[i], &plots[i]);
	if (job->folder) {
		char path[1024];

		snprintf(path, sizeof(path), "%s/growth.svg", job->folder);
		if (!stress_plots_write(plots, LINES, path))
			exit(1);
	}
}
