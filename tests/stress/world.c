#include "stress/world.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/model.h"
#include "support/files.h"
#include "support/random_model.h"
#include "weights/open.h"

const struct stress_recipe stress_recipe_base = {
	.name = "base",
	.config = {.dim = 64,
		   .heads = 2,
		   .layers = 3,
		   .patch_px = 8,
		   .mlp_ratio = 4,
		   .norm_eps = 1e-6},
	.views = 3,
	.width = 48,
	.height = 48,
};

const struct stress_recipe stress_recipe_shipped = {
	.name = "shipped",
	.model_path = STRESS_SHIPPED_MODEL,
	.views = 3,
	.width = 64,
	.height = 64,
	.patch_px = 8,
};

/* ---- making a world ---- */

static void give_up(const char *name, const char *fault)
{
	fprintf(stderr, "stress: %s: %s\n", name, fault);
	exit(1);
}

/* False when the engine refuses the weights. */
static bool make_model(struct stress_world *world, struct dvsm_error *error)
{
	const struct stress_recipe *recipe = &world->recipe;
	const char *name = recipe->model_path ? recipe->model_path : recipe->name;
	struct support_random random = {recipe->seed};
	size_t size;
	unsigned char *bytes = recipe->model_path
				       ? support_read_file(recipe->model_path, &size)
				       : support_random_model_file(&recipe->config, &random, &size);

	if (!bytes)
		give_up(name, "the model cannot be made");
	if (recipe->twist)
		stress_twist_file(bytes, size, &recipe->config, recipe->twist,
				  recipe->twist_amount);
	if (dvsm_model_open_bytes(bytes, size, name, &world->model, error) == DVSM_OK) {
		world->reference = support_reference_open_bytes(bytes, size, name);
		if (!world->reference)
			exit(1);
	}
	free(bytes);
	return world->model;
}

/* Waves of a few periods, other ones in each channel and view. */
static float wave(uint32_t view, size_t x, size_t y, size_t channel)
{
	double phase = 0.9 * view + 2.1 * (double)channel;

	return (float)(0.5 + 0.25 * sin(0.21 * (double)x + 0.13 * (double)y + phase) +
		       0.2 * sin(0.05 * (double)x - 0.34 * (double)y + 1.7 * phase));
}

static float colour(enum stress_picture picture, struct support_random *random, uint32_t view,
		    size_t x, size_t y, size_t channel)
{
	switch (picture) {
	case STRESS_SMOOTH:
		return wave(view, x, y, channel);
	case STRESS_EQUAL:
		return wave(0, x, y, channel);
	case STRESS_NOISE:
		return 0.5f + 0.5f * support_random_unit(random);
	case STRESS_SPECKLED:
		return (float)((x + y) % 2);
	case STRESS_BLACK:
		return 0;
	case STRESS_WHITE:
		return 1;
	case STRESS_GREY:
		return 0.5f;
	case STRESS_LOWEST:
		return -1;
	case STRESS_HIGHEST:
		return 2;
	}
	return 0;
}

static void paint(struct stress_world *world)
{
	const struct stress_recipe *recipe = &world->recipe;
	struct support_random random = {recipe->seed + 1};
	size_t numbers = 0;

	for (uint32_t v = 0; v < recipe->views; v++)
		numbers += (size_t)world->views[v].camera.width * world->views[v].camera.height * 3;
	world->rgb = support_reference_allocate(numbers, sizeof(world->rgb[0]));

	float *rgb = world->rgb;

	for (uint32_t v = 0; v < recipe->views; v++) {
		const struct dvsm_camera *camera = &world->views[v].camera;

		world->views[v].rgb = rgb;
		for (size_t y = 0; y < camera->height; y++) {
			for (size_t x = 0; x < camera->width; x++) {
				for (size_t c = 0; c < 3; c++)
					*rgb++ = colour(recipe->picture, &random, v, x, y, c);
			}
		}
	}
}

/* An arc of 120 degrees, on which the mean direction is far from vanishing, up and down a little so
 * that no coordinate is the same for all. */
static struct dvsm_camera arc_camera(const struct stress_recipe *recipe, double place)
{
	uint32_t step = (uint32_t)lround(place * 8192);
	struct dvsm_camera camera =
		support_ring_camera(recipe->width, recipe->height, step, 3 * 8192);

	camera.world_from_camera[7] += 0.3 * sin(9 * place);
	return camera;
}

static void place_rig(struct stress_world *world)
{
	const struct stress_recipe *recipe = &world->recipe;

	world->views = support_reference_allocate(recipe->views, sizeof(world->views[0]));
	for (uint32_t v = 0; v < recipe->views; v++)
		world->views[v].camera = arc_camera(recipe, (v + 0.5) / recipe->views);
	world->target = arc_camera(recipe, 0.4);
	if (recipe->rig)
		recipe->rig(world->views, recipe->views, &world->target, recipe->rig_amount);
}

struct stress_world *stress_world_try(const struct stress_recipe *recipe, struct dvsm_error *error)
{
	struct stress_world *world = support_reference_allocate(1, sizeof(*world));

	world->recipe = *recipe;
	if (!make_model(world, error)) {
		stress_world_free(world);
		return NULL;
	}
	world->recipe.config = *dvsm_model_get_config(world->model);
	place_rig(world);
	paint(world);
	world->numbers = (size_t)world->target.width * world->target.height * 3;
	return world;
}

struct stress_world *stress_world_make(const struct stress_recipe *recipe)
{
	struct dvsm_error error = {""};
	struct stress_world *world = stress_world_try(recipe, &error);

	if (!world)
		give_up(recipe->name, error.text);
	return world;
}

void stress_world_free(struct stress_world *world)
{
	if (!world)
		return;
	dvsm_model_close(world->model);
	support_reference_close(world->reference);
	free(world->views);
	free(world->rgb);
	free(world->expected);
	free(world);
}

const double *stress_world_expect(struct stress_world *world)
{
	if (world->expected)
		return world->expected;

	const struct stress_recipe *recipe = &world->recipe;
	struct support_reference_scene *scene = support_reference_reconstruct(
		world->reference, world->views, recipe->views, recipe->patch_px);

	world->expected = support_reference_allocate(world->numbers, sizeof(world->expected[0]));
	support_reference_render(world->reference, scene, &world->target, recipe->patch_px,
				 world->expected);
	support_reference_scene_free(scene);
	return world->expected;
}

/* ---- running it ---- */

struct stress_outcome stress_world_run(const struct stress_world *world,
				       const struct stress_way *way)
{
	const struct dvsm_engine_options options = {
		.threads = way->threads,
		.cpu_mask = way->cpu_mask,
		.precision = way->precision,
	};
	const struct stress_recipe *recipe = &world->recipe;
	struct stress_outcome outcome = {0};
	struct dvsm_stats recon = {0}, render = {0};
	struct dvsm_engine *engine = NULL;
	struct dvsm_scene *scene = NULL;
	float *picture = support_reference_allocate(world->numbers, sizeof(*picture));

	outcome.status = dvsm_engine_create(world->model, &options, &engine, &outcome.error);
	if (outcome.status == DVSM_OK)
		outcome.status =
			dvsm_reconstruct(engine, world->views, recipe->views, recipe->patch_px,
					 NULL, NULL, &scene, &recon, &outcome.error);
	if (outcome.status == DVSM_OK)
		outcome.status = dvsm_render(engine, scene, &world->target, recipe->patch_px,
					     picture, &render, &outcome.error);
	if (outcome.status == DVSM_OK) {
		outcome.picture = picture;
		outcome.saturated = recon.saturated + render.saturated;
	} else {
		free(picture);
	}
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
	return outcome;
}

void stress_outcome_deinit(struct stress_outcome *outcome)
{
	free(outcome->picture);
	outcome->picture = NULL;
}

/* ---- comparing ---- */

/* Far beyond white and black colours are all the same; integers end at 128. */
#define FARTHEST_COLOUR 100.0

static double seen(double colour)
{
	return fmin(fmax(colour, -FARTHEST_COLOUR), FARTHEST_COLOUR);
}

struct stress_error stress_compare(const float *got, const double *want, size_t count)
{
	struct stress_error error = {0};
	double squares = 0, size = 0;

	for (size_t i = 0; i < count; i++) {
		double difference = seen(got[i]) - seen(want[i]);

		error.not_finite += !isfinite(got[i]);
		error.largest = fmax(error.largest, fabs(difference));
		squares += difference * difference;
		size += seen(want[i]) * seen(want[i]);
	}
	if (error.not_finite > 0) {
		error.largest = error.relative = INFINITY;
		error.psnr_db = -INFINITY;
		return error;
	}
	/* Pictures are of the size of 1/2; a black one would make any error a large one. */
	error.relative = sqrt(squares / fmax(size, 0.25 * (double)count));
	error.psnr_db = -10 * log10(squares / (double)count);
	return error;
}

struct stress_error stress_compare_pictures(const float *got, const float *want, size_t count)
{
	double *wide = support_reference_allocate(count, sizeof(*wide));

	for (size_t i = 0; i < count; i++)
		wide[i] = want[i];

	struct stress_error error = stress_compare(got, wide, count);

	free(wide);
	return error;
}

/* ---- what there is ---- */

/* An engine for the base model; NULL when this build or machine does not have it. */
static struct dvsm_engine *try_engine(const struct dvsm_model *model, enum dvsm_precision precision,
				      uint32_t cpu_mask)
{
	const struct dvsm_engine_options options = {
		.threads = 1,
		.cpu_mask = cpu_mask,
		.precision = precision,
	};
	struct dvsm_engine *engine = NULL;
	struct dvsm_error error;

	return dvsm_engine_create(model, &options, &engine, &error) == DVSM_OK ? engine : NULL;
}

size_t stress_precisions(enum dvsm_precision precisions[STRESS_PRECISIONS])
{
	static const enum dvsm_precision all[] = {DVSM_PRECISION_F32, DVSM_PRECISION_BF16,
						  DVSM_PRECISION_FIXED};
	struct stress_world *world = stress_world_make(&stress_recipe_base);
	size_t count = 0;

	for (size_t i = 0; i < sizeof(all) / sizeof(all[0]); i++) {
		struct dvsm_engine *engine = try_engine(world->model, all[i], 0);

		if (engine)
			precisions[count++] = all[i];
		else
			printf("precision %s is not in this build\n", dvsm_precision_name(all[i]));
		dvsm_engine_destroy(engine);
	}
	stress_world_free(world);
	return count;
}

size_t stress_tiers(enum dvsm_precision precision, uint32_t masks[STRESS_TIERS])
{
	const uint32_t here = dvsm_cpu_detect();
	struct stress_world *world = stress_world_make(&stress_recipe_base);
	const char *names[STRESS_TIERS];
	size_t count = 0;

	/* A tier comes with those below it; where it changes nothing, the engine says the name of
	 * the one below. */
	for (uint32_t bit = 1; bit != 0 && count < STRESS_TIERS; bit <<= 1) {
		uint32_t mask = here & (bit | (bit - 1));
		struct dvsm_engine *engine =
			here & bit ? try_engine(world->model, precision, mask) : NULL;

		if (engine &&
		    (count == 0 || strcmp(names[count - 1], dvsm_engine_get_cpu(engine)) != 0)) {
			names[count] = dvsm_engine_get_cpu(engine);
			masks[count++] = mask;
		}
		dvsm_engine_destroy(engine);
	}
	stress_world_free(world);
	return count;
}
