#include "forward/picture.h"

#include <stdbool.h>

#include "geometry/deblock.h"
#include "geometry/rays.h"
#include "geometry/resample.h"

/* Rays of a token are q^2 divisions and roots: a few tokens make a task. */
#define RAY_TOKENS 8u

/* Rows of the finished picture that make a task. */
#define PICTURE_ROWS 16u

struct picture_job {
	const struct dvsm_run *run;
	const struct dvsm_ray_map *map;
	const struct dvsm_patch_plan *plan;
	const float *rgb;
	float *patches;
	const struct dvsm_picture_out *out;
	size_t count; /* tokens */
};

static void ray_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	const size_t width = 6 * (size_t)job->map->patch_px * job->map->patch_px;
	size_t first = index * RAY_TOKENS;

	(void)worker;
	dvsm_ray_map_write(job->map, first, dvsm_tile_length(job->count, RAY_TOKENS, index),
			   job->patches + first * width);
}

static void cut_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;

	dvsm_patch_cut_rows(job->plan, job->rgb, (uint32_t)index, 1, job->patches,
			    dvsm_run_scratch(job->run, worker));
}

/* The patches in work.wide to tokens. */
static void embed(const struct dvsm_run *run, size_t tokens, const struct dvsm_matrix *w, float *x,
		  enum dvsm_epilogue epilogue)
{
	dvsm_step_convert(run, run->work.wide, tokens, w->in, run->work.patches);
	dvsm_step_product(run, run->work.patches, tokens, w, x, run->model->config.dim, epilogue);
}

void dvsm_picture_embed(const struct dvsm_run *run, const struct dvsm_camera *camera,
			const struct dvsm_normalisation *normalisation, uint32_t patch_px,
			const float *rgb, float *x)
{
	const uint32_t side = run->model->config.patch_px;
	const struct dvsm_ray_map map = dvsm_ray_map_prepare(camera, normalisation, side, patch_px);
	const struct dvsm_patch_plan plan =
		dvsm_patch_plan_make(camera->width, camera->height, side, patch_px);
	const size_t tokens = dvsm_token_grid_count(plan.grid);
	struct picture_job job = {
		.run = run,
		.map = &map,
		.plan = &plan,
		.rgb = rgb,
		.patches = run->work.wide,
		.count = tokens,
	};

	dvsm_pool_run(run->pool, dvsm_tiles(tokens, RAY_TOKENS), ray_task, &job);
	embed(run, tokens, &run->weights->patch_ray, x, DVSM_EPILOGUE_STORE);
	if (rgb) {
		dvsm_pool_run(run->pool, plan.grid.rows, cut_task, &job);
		embed(run, tokens, &run->weights->patch_rgb, x, DVSM_EPILOGUE_ADD);
	}
	dvsm_step_embed_norm(run, x, tokens, run->weights->embed_norm);
}

/* A row of tokens. */
static void colour_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	const size_t numbers = job->plan->grid.columns * job->run->weights->to_rgb.out;

	(void)worker;
	job->run->kernels->to_colour(job->patches + index * numbers, numbers,
				     job->run->model->config.rgb_sigmoid);
	if (job->run->deblock)
		dvsm_deblock_row(job->plan, job->patches, (uint32_t)index);
}

static void seam_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;

	(void)worker;
	dvsm_deblock_seam(job->plan, job->patches, (uint32_t)index);
}

/* The first test also sends a number that is not finite to black. */
static uint8_t byte_of(float colour)
{
	double value = (double)colour * 255 + 0.5;

	return !(value > 0) ? 0 : value >= 255 ? 255 : (uint8_t)value;
}

static void join_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	const size_t numbers = 3 * (size_t)job->plan->width;
	uint32_t first = (uint32_t)(index * PICTURE_ROWS);
	uint32_t end = first + (uint32_t)dvsm_tile_length(job->plan->height, PICTURE_ROWS, index);
	unsigned char *scratch = dvsm_run_scratch(job->run, worker);

	for (uint32_t y = first; y < end; y++) {
		float *row = job->out->rgb ? job->out->rgb + y * numbers
					   : (float *)(void *)(scratch + job->plan->scratch_bytes);

		dvsm_patch_join_row(job->plan, job->patches, y, row, scratch);
		for (size_t i = 0; job->out->bytes && i < numbers; i++)
			job->out->bytes[y * numbers + i] = byte_of(row[i]);
	}
}

void dvsm_picture_write(const struct dvsm_run *run, const struct dvsm_camera *camera,
			uint32_t patch_px, const float *x, const struct dvsm_picture_out *out)
{
	const struct dvsm_patch_plan plan = dvsm_patch_plan_make(
		camera->width, camera->height, run->model->config.patch_px, patch_px);
	const struct dvsm_matrix *to_rgb = &run->weights->to_rgb;
	struct picture_job job = {
		.run = run,
		.plan = &plan,
		.patches = run->work.wide,
		.out = out,
		.count = dvsm_token_grid_count(plan.grid),
	};

	dvsm_step_norm(run, x, job.count, run->weights->final_norm, run->work.normed);
	dvsm_step_product(run, run->work.normed, job.count, to_rgb, job.patches, to_rgb->out,
			  DVSM_EPILOGUE_STORE);
	dvsm_pool_run(run->pool, plan.grid.rows, colour_task, &job);
	if (run->deblock)
		dvsm_pool_run(run->pool, plan.grid.rows - 1, seam_task, &job);
	dvsm_pool_run(run->pool, dvsm_tiles(plan.height, PICTURE_ROWS), join_task, &job);
}
