/* A model, a rig with pictures, a viewpoint, and what the reference in double makes of them. */
#ifndef TESTS_STRESS_WORLD_H
#define TESTS_STRESS_WORLD_H

#include <stdbool.h>

#include "dvsm/dvsm.h"
#include "stress/report.h"
#include "stress/twist.h"
#include "support/reference64.h"

/** What the context pictures show. */
enum stress_picture {
	STRESS_SMOOTH, /* waves that differ from view to view */
	STRESS_NOISE,
	STRESS_BLACK,
	STRESS_WHITE,
	STRESS_GREY,
	STRESS_LOWEST,   /* -1, the least the engine takes */
	STRESS_HIGHEST,  /* 2, the most */
	STRESS_SPECKLED, /* 0 and 1 by turns, pixel by pixel */
	STRESS_EQUAL,    /* the same waves in every view */
};

/** Changes a rig after it was placed: cameras of the views, [count], and the target. */
typedef void stress_rig_fn(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			   double amount);

/** All that is not said stays as stress_recipe_base says. */
struct stress_recipe {
	const char *name;
	struct dvsm_model_config config;
	uint32_t views, width, height; /* of the target too */
	enum stress_picture picture;
	stress_twist_fn *twist; /* NULL: the random weights as they are */
	double twist_amount;
	stress_rig_fn *rig; /* NULL: an arc of a third of a circle */
	double rig_amount;
	const char *model_path; /* NULL: random weights */
	uint32_t patch_px;      /* of both stages; 0: the model's */
	uint64_t seed;          /* of random weights; that of pictures is one more */
};

/** D 64, 2 heads, 3 blocks, patch 8; 3 views of 48 x 48 pixels, 36 tokens each. */
extern const struct stress_recipe stress_recipe_base;

/** The shipped model, with views of 64 tokens, as many as it was trained with. */
extern const struct stress_recipe stress_recipe_shipped;

struct stress_world {
	struct stress_recipe recipe;
	struct dvsm_model *model;
	struct support_reference *reference;
	struct dvsm_view *views; /* [recipe.views] */
	float *rgb;              /* all pictures */
	struct dvsm_camera target;
	size_t numbers;   /* of the target's picture */
	double *expected; /* NULL until stress_world_expect() */
};

/** Exits with a line when it cannot be made. Release with stress_world_free(). */
struct stress_world *stress_world_make(const struct stress_recipe *recipe);

/** The same, but NULL and the reason when the engine refuses the weights. */
struct stress_world *stress_world_try(const struct stress_recipe *recipe, struct dvsm_error *error);
void stress_world_free(struct stress_world *world);

/** The target as the reference renders it, made on the first call; owned by the world. */
const double *stress_world_expect(struct stress_world *world);

/** How the engine shall run. */
struct stress_way {
	enum dvsm_precision precision;
	uint32_t cpu_mask; /* 0: all */
	uint32_t threads;
};

/** What came out. */
struct stress_outcome {
	enum dvsm_status status;
	struct dvsm_error error;
	float *picture;     /* [numbers]; NULL unless status is DVSM_OK; owned */
	uint64_t saturated; /* by both stages */
};

/** Reconstruct and render once. Release with stress_outcome_deinit(). */
struct stress_outcome stress_world_run(const struct stress_world *world,
				       const struct stress_way *way);
void stress_outcome_deinit(struct stress_outcome *outcome);

/** How far a picture is from what it should be; colours beyond +-100 count as that. */
struct stress_error {
	size_t not_finite; /* numbers; the others are infinite when there are any */
	double largest;    /* absolute difference */
	double relative; /* root mean square of the difference over that of `want` (1/2 at least) */
	double psnr_db;  /* peak 1 */
};

struct stress_error stress_compare(const float *got, const double *want, size_t count);
struct stress_error stress_compare_pictures(const float *got, const float *want, size_t count);

/** The precisions of this build, [DVSM_PRECISIONS at most]; how many. */
#define STRESS_PRECISIONS 3
size_t stress_precisions(enum dvsm_precision precisions[STRESS_PRECISIONS]);

/** Masks that choose each instruction-set tier in turn which this machine has for a precision; how
 * many. */
#define STRESS_TIERS 16
size_t stress_tiers(enum dvsm_precision precision, uint32_t masks[STRESS_TIERS]);

/** What the parts of the test are given. */
struct stress_job {
	struct stress_report *report;
	const char *folder; /* for plots; NULL: draw none */
	uint32_t threads;
	uint64_t seed; /* of all recipes */
	bool quick;    /* a minute at most */
	enum dvsm_precision precisions[STRESS_PRECISIONS];
	size_t precision_count;
};

void stress_extremes(const struct stress_job *job);
void stress_growth(const struct stress_job *job);
void stress_invariants(const struct stress_job *job);
void stress_loop(const struct stress_job *job);

#endif
