#include "fixed/picture.h"

#include <math.h>
#include <string.h>

#include "fixed/deblock.h"
#include "fixed/resample.h"
#include "fixed/turn.h"
#include "geometry/rays.h"
#include "kernels/fixed_math.h"

/* Rays of a token are q^2 divisions and roots: a few tokens make a task. */
#define RAY_TOKENS 8u

/* Rows of the finished picture that make a task. */
#define PICTURE_ROWS 16u

/* Rays and colours below these powers of two never leave the embedding's 32 bits. */
#define NEAR_RAY_BITS    1
#define NEAR_COLOUR_BITS 2

struct picture_job {
	const struct dvsm_fixed_run *run;
	const struct dvsm_ray_map *map;
	const struct dvsm_patch_plan *plan;
	const float *rgb;
	int32_t *x;
	const struct dvsm_picture_out *out;
	size_t count, width; /* tokens, and numbers of each */
	int near_bits;       /* numbers below 2^near_bits stand for themselves */
};

/* ---- embedding ---- */

/* Largest number of a token, as the exponent of the power of two above it. Of several at a time:
 * compilers make vectors of that. */
static int exponent_of(const float *numbers, size_t count)
{
	float largest[8] = {0};
	int exponent = 0;
	size_t i = 0;

	for (; i + 8 <= count; i += 8) {
		for (size_t k = 0; k < 8; k++) {
			float size = fabsf(numbers[i + k]);

			largest[k] = size > largest[k] ? size : largest[k];
		}
	}
	for (; i < count; i++)
		largest[0] = fabsf(numbers[i]) > largest[0] ? fabsf(numbers[i]) : largest[0];
	for (size_t k = 1; k < 8; k++)
		largest[0] = largest[k] > largest[0] ? largest[k] : largest[0];
	frexpf(largest[0], &exponent);
	return largest[0] > 0 ? exponent : INT16_MIN;
}

/*
 * 256 high + low = floor(number unit + 1/2), at most 2^14 either way. The product is exact, as unit
 * is a power of two, and so is the sum where it comes near a whole number: of 24 bits none is below
 * 2^-37 there. Above 0 conversion rounds down.
 */
static void split_numbers(const float *restrict numbers, size_t count, double unit,
			  int8_t *restrict high, int8_t *restrict low)
{
	const int above = 1 << 15;

	for (size_t i = 0; i < count; i++) {
		int number = (int)(numbers[i] * unit + (above + 0.5)) - above;

		high[i] = (int8_t)((number + 128) >> 8);
		low[i] = (int8_t)number;
	}
}

/* A token's floats to two planes of int8 that stand for 14 bits and a sign. */
static void split_token(const struct picture_job *job, size_t token)
{
	const struct dvsm_fixed_workspace *work = &job->run->work;
	const float *numbers = work->patches + token * job->width;
	size_t depth = dvsm_fixed_pad(job->width, DVSM_FIXED_DEPTH);
	int8_t *high = work->a + token * depth, *low = work->a_low + token * depth;
	int exponent = exponent_of(numbers, job->width);
	/* A target far outside the rig has long moments: its whole token is made smaller, which
	 * the norm behind the embedding does not see. */
	int far = exponent > job->near_bits ? exponent - job->near_bits : 0;

	memset(high, 0, depth);
	memset(low, 0, depth);
	work->a_scale[token] = (struct dvsm_fixed_scale){0, 0};
	if (exponent == INT16_MIN)
		return;
	split_numbers(numbers, job->width, ldexp(1, 14 - exponent), high, low);
	work->a_scale[token] = (struct dvsm_fixed_scale){1 << 14, (int16_t)(exponent - far - 28)};
}

static void ray_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	size_t first = index * RAY_TOKENS, count = dvsm_tile_length(job->count, RAY_TOKENS, index);

	(void)worker;
	dvsm_ray_map_write(job->map, first, count, job->run->work.patches + first * job->width);
	for (size_t token = first; token < first + count; token++)
		split_token(job, token);
}

static void cut_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	size_t columns = job->plan->grid.columns;

	dvsm_patch_cut_rows(job->plan, job->rgb, (uint32_t)index, 1, job->run->work.patches,
			    dvsm_fixed_scratch(job->run, worker));
	for (size_t token = index * columns; token < (index + 1) * columns; token++)
		split_token(job, token);
}

/* sums += (256 high + low) W^T. */
static void add_planes(const struct dvsm_fixed_run *run, size_t tokens,
		       const struct dvsm_fixed_matrix *w)
{
	const struct dvsm_fixed_workspace *work = &run->work;
	struct dvsm_fixed_product product = {
		.a = work->a_low, .w = w, .c = work->sums, .epilogue = DVSM_FIXED_ADD};

	dvsm_fixed_step_products(run, tokens, &product, 1);
	for (size_t i = 0; i < tokens; i++)
		work->a_scale[i] = dvsm_fixed_shift(work->a_scale[i], 8);
	product.a = work->a;
	dvsm_fixed_step_products(run, tokens, &product, 1);
}

/* x = Q (256 high + low) scale. */
static void stream_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	const struct dvsm_fixed_workspace *work = &job->run->work;
	const size_t dim = job->run->config->dim, depth = dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH);
	const struct dvsm_fixed_scale scale = work->a_scale[index];
	int32_t *x = job->x + index * dim;
	int shift = dvsm_fixed_clamp(
		dvsm_fixed_turn_stages(dim) - (scale.exponent + job->run->model->fraction), 0, 62);

	(void)worker;
	for (size_t d = 0; d < dim; d++)
		x[d] = work->a[index * depth + d] * 256 + work->a_low[index * depth + d];
	dvsm_fixed_turn_integers(x, dim);
	for (size_t d = 0; d < dim; d++)
		x[d] = (int32_t)dvsm_fixed_round((int64_t)x[d] * scale.mantissa, shift);
}

void dvsm_fixed_picture_embed(const struct dvsm_fixed_run *run, const struct dvsm_camera *camera,
			      const struct dvsm_normalisation *normalisation, uint32_t patch_px,
			      const float *rgb, int32_t *x)
{
	const uint32_t side = run->config->patch_px;
	const struct dvsm_ray_map map = dvsm_ray_map_prepare(camera, normalisation, side, patch_px);
	const struct dvsm_patch_plan plan =
		dvsm_patch_plan_make(camera->width, camera->height, side, patch_px);
	const struct dvsm_fixed_model *model = run->model;
	const size_t area = (size_t)side * side;
	struct picture_job job = {
		.run = run,
		.map = &map,
		.plan = &plan,
		.rgb = rgb,
		.x = x,
		.count = dvsm_token_grid_count(plan.grid),
		.width = 6 * area,
		.near_bits = NEAR_RAY_BITS,
	};

	memset(run->work.sums, 0, job.count * run->config->dim * sizeof(int32_t));
	dvsm_pool_run(run->pool, dvsm_tiles(job.count, RAY_TOKENS), ray_task, &job);
	add_planes(run, job.count, &model->patch_ray);
	if (rgb) {
		job.width = 3 * area;
		job.near_bits = NEAR_COLOUR_BITS;
		dvsm_pool_run(run->pool, plan.grid.rows, cut_task, &job);
		add_planes(run, job.count, &model->patch_rgb);
	}
	dvsm_fixed_step_norm_planes(run, run->work.sums, job.count, &model->embed_norm);
	dvsm_pool_run(run->pool, job.count, stream_task, &job);
}

/* ---- picture ---- */

/* To the limits; *clamped grows when that changes it. */
static int32_t clamp_colour(int64_t wide, uint64_t *clamped)
{
	if (wide >= -DVSM_FIXED_COLOUR_LIMIT && wide <= DVSM_FIXED_COLOUR_LIMIT)
		return (int32_t)wide;
	++*clamped;
	return wide < 0 ? -DVSM_FIXED_COLOUR_LIMIT : DVSM_FIXED_COLOUR_LIMIT;
}

static int32_t colour_of(int32_t y, int fraction, bool sigmoid, uint64_t *clamped)
{
	/* Where a unit is worth more than all colours there are, how much more does not matter. */
	int up = dvsm_fixed_clamp(DVSM_FIXED_COLOUR - fraction, 0, 31);
	int64_t wide = (int64_t)y * ((int64_t)1 << up);
	uint64_t unseen = 0;

	/* A sigmoid is 0 or 1 long before its argument's limits. */
	if (sigmoid)
		return dvsm_fixed_sigmoid(clamp_colour(wide, &unseen));
	return clamp_colour((1 << (DVSM_FIXED_COLOUR - 1)) + dvsm_fixed_round(wide, 1), clamped);
}

/* A row of tokens. */
static void colour_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	const size_t count = job->plan->grid.columns * job->width;
	int32_t *y = job->run->work.sums + index * count;
	uint64_t clamped = 0;

	(void)worker;
	for (size_t i = 0; i < count; i++)
		y[i] = colour_of(y[i], job->run->model->rgb_fraction, job->run->config->rgb_sigmoid,
				 &clamped);
	if (clamped)
		atomic_fetch_add(job->run->clamped, clamped);
	if (job->run->deblock)
		dvsm_fixed_deblock_row(job->plan, job->run->work.sums, (uint32_t)index);
}

static void seam_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;

	(void)worker;
	dvsm_fixed_deblock_seam(job->plan, job->run->work.sums, (uint32_t)index);
}

static void join_task(void *context, size_t index, uint32_t worker)
{
	const struct picture_job *job = context;
	const struct dvsm_patch_plan *plan = job->plan;
	size_t row_numbers = 3 * (size_t)plan->width;
	uint32_t first = (uint32_t)(index * PICTURE_ROWS);
	uint32_t end = first + (uint32_t)dvsm_tile_length(plan->height, PICTURE_ROWS, index);

	for (uint32_t y = first; y < end; y++) {
		const int32_t *row = dvsm_fixed_join_row(plan, job->run->work.sums, y,
							 dvsm_fixed_scratch(job->run, worker));
		size_t at = y * row_numbers;

		for (size_t i = 0; job->out->rgb && i < row_numbers; i++)
			job->out->rgb[at + i] = (float)row[i] / (1 << DVSM_FIXED_COLOUR);
		for (size_t i = 0; job->out->bytes && i < row_numbers; i++)
			job->out->bytes[at + i] = dvsm_fixed_colour_byte(row[i]);
	}
}

void dvsm_fixed_picture_write(const struct dvsm_fixed_run *run, const struct dvsm_camera *camera,
			      uint32_t patch_px, const int32_t *x,
			      const struct dvsm_picture_out *out)
{
	const struct dvsm_patch_plan plan = dvsm_patch_plan_make(camera->width, camera->height,
								 run->config->patch_px, patch_px);
	struct picture_job job = {
		.run = run,
		.plan = &plan,
		.out = out,
		.count = dvsm_token_grid_count(plan.grid),
		.width = run->model->to_rgb.out,
	};

	dvsm_fixed_step_norm_planes(run, x, job.count, &run->model->final_norm);
	memset(run->work.sums, 0, job.count * job.width * sizeof(int32_t));
	add_planes(run, job.count, &run->model->to_rgb);
	dvsm_pool_run(run->pool, plan.grid.rows, colour_task, &job);
	if (run->deblock)
		dvsm_pool_run(run->pool, plan.grid.rows - 1, seam_task, &job);
	dvsm_pool_run(run->pool, dvsm_tiles(plan.height, PICTURE_ROWS), join_task, &job);
}
