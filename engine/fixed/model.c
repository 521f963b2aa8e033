#include "fixed/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"
#include "base/error.h"
#include "base/memory.h"
#include "fixed/fine.h"
#include "fixed/turn.h"
#include "kernels/fixed_math.h"
#include "model/reader.h"

/* Fraction bits beyond which nothing is gained. */
#define MAX_STREAM_FRACTION 20
#define MAX_RGB_FRACTION    16
#define MAX_EMBED_FRACTION  20

/* Fraction bits of an embedded token's typical number, without which the first norm sees noise. */
#define LEAST_TOKEN_BITS 4

/* Rays of a token are brought below 2, colours are -1..2 and become -3..3. */
#define RAY_PEAK    2.0
#define COLOUR_PEAK 3.0

/* What int8 activations and 15-bit scales may add to a bound that holds for real numbers. */
#define SLACK 1.02

/* Numbers a row of a product's input, which its sums of 32 bits hold. */
#define MOST_DEPTH 65536

/*
 * The walk over the model. It runs twice over the same code: first without memory, to add up the
 * space, then to fill it.
 */
struct build {
	const struct dvsm_model *model;
	struct dvsm_reader *reader;
	struct dvsm_arena arena;
	double *rows;                /* room for the largest matrix, turned */
	int8_t *numbers;             /* the matrix at hand */
	int8_t *planes;              /* and, where it is fine, both of its planes */
	double stream;               /* bound of the residual stream so far */
	struct dvsm_fixed_gain unit; /* of all norms but the embedding's */
};

static bool filling(const struct build *build)
{
	return build->arena.base != NULL;
}

/* ---- norms ---- */

/* A norm's weight in 16 bits; returns the largest number that can lie behind it. */
static double take_gain(struct build *build, const float *weights, struct dvsm_fixed_gain *gain)
{
	const size_t dim = build->model->config.dim;
	int16_t *gains = dvsm_arena_take(&build->arena, dim, sizeof(*gains));
	double largest = 0;

	if (!filling(build))
		return 0;
	int exponent = dvsm_fixed_quantise_gain(weights, dim, gains);

	gain->gain = gains;
	gain->scale = dvsm_fixed_shift(dvsm_fixed_scale_near(sqrt((double)dim)), exponent);
	for (size_t d = 0; d < dim; d++)
		largest = fmax(largest, fabs(ldexp(gains[d], exponent)));
	return sqrt((double)dim) * largest;
}

/* Weights of all other norms are part of the matrices behind them: what is left is 1. */
static void take_unit(struct build *build)
{
	const size_t dim = build->model->config.dim;
	int16_t *gains = dvsm_arena_take(&build->arena, dim, sizeof(*gains));

	for (size_t d = 0; filling(build) && d < dim; d++)
		gains[d] = 1 << 14;
	build->unit.gain = gains;
	build->unit.scale = dvsm_fixed_shift(dvsm_fixed_scale_near(sqrt((double)dim)), -14);
}

/* ---- matrices ---- */

/* W beside R(W, 4), each padded. */
static void put_planes(struct build *build, size_t out, size_t in, size_t plane)
{
	memset(build->planes, 0, 2 * out * plane);
	for (size_t j = 0; j < out; j++) {
		const int8_t *numbers = build->numbers + j * in;
		int8_t *high = build->planes + 2 * j * plane, *low = high + plane;

		for (size_t d = 0; d < in; d++) {
			high[d] = numbers[d];
			low[d] = dvsm_fixed_fine_low(numbers[d]);
		}
	}
}

static struct dvsm_fixed_matrix take_matrix(struct build *build,
					    const struct dvsm_fixed_place *place)
{
	const size_t out = place->matrix->out, in = place->matrix->in;
	const size_t plane = dvsm_fixed_pad(in, DVSM_FIXED_DEPTH);
	const bool fine = place->fine && 2 * plane <= MOST_DEPTH;
	const size_t depth = fine ? 2 * plane : plane;
	int8_t *panels =
		dvsm_arena_take(&build->arena, dvsm_fixed_pad(out, DVSM_FIXED_PANEL), depth);
	int32_t *sums = dvsm_arena_take(&build->arena, out, sizeof(*sums));
	int16_t *mantissas = dvsm_arena_take(&build->arena, out, sizeof(*mantissas));
	int16_t *shifts = dvsm_arena_take(&build->arena, out, sizeof(*shifts));

	if (filling(build)) {
		const struct dvsm_matrix matrix = dvsm_reader_read(build->reader, place->matrix);
		struct dvsm_fixed_place read = *place;

		read.matrix = &matrix;
		dvsm_fixed_turn_matrix(&read, build->rows);
		for (size_t j = 0; j < out; j++) {
			int8_t *numbers = build->numbers + j * in;
			struct dvsm_fixed_scale scale =
				dvsm_fixed_quantise_row(build->rows + j * in, in, numbers);

			mantissas[j] = scale.mantissa;
			shifts[j] = (int16_t)-scale.exponent;
			sums[j] = 0;
			for (size_t d = 0; d < in; d++)
				sums[j] +=
					numbers[d] + (fine ? dvsm_fixed_fine_low(numbers[d]) : 0);
		}
		if (fine)
			put_planes(build, out, in, plane);
		dvsm_fixed_pack_panels(fine ? build->planes : build->numbers, out,
				       fine ? depth : in, panels);
	}
	return (struct dvsm_fixed_matrix){panels, sums, mantissas, shifts, out, in, depth, fine};
}

/* Results of row j in units of 2^-fraction. */
static void set_fraction(const struct dvsm_fixed_matrix *matrix, size_t row, int fraction)
{
	matrix->shifts[row] = (int16_t)(matrix->shifts[row] - fraction);
}

static void set_fractions(const struct dvsm_fixed_matrix *matrix, int fraction)
{
	for (size_t j = 0; j < matrix->out; j++)
		set_fraction(matrix, j, fraction);
}

/*
 * The largest that a row of the matrix taken last can give for an input of length `length`:
 * Cauchy-Schwarz for the input as it is, and half a step of its int8 form - at most length / 252 -
 * against every weight.
 */
static double bound_row(const struct build *build, const struct dvsm_fixed_matrix *matrix,
			size_t row, double length)
{
	const int8_t *numbers = build->numbers + row * matrix->in;
	double squares = 0, sizes = 0;
	double unit = ldexp(matrix->mantissas[row], -matrix->shifts[row]);

	for (size_t d = 0; d < matrix->in; d++) {
		double w = numbers[d];

		squares += w * w;
		sizes += abs(numbers[d]);
	}
	return SLACK * unit *
	       (sqrt(squares) * length + sizes * length / (matrix->fine ? 126 : 252));
}

/* The largest that any row of the matrix taken last can give for numbers up to `peak`. */
static double bound_sums(const struct build *build, const struct dvsm_fixed_matrix *matrix,
			 double peak)
{
	double largest = 0;

	for (size_t j = 0; j < matrix->out; j++) {
		double unit = ldexp(matrix->mantissas[j], -matrix->shifts[j]), sizes = 0;

		for (size_t d = 0; d < matrix->in; d++)
			sizes += abs(build->numbers[j * matrix->in + d]);
		largest = fmax(largest, SLACK * unit * sizes * peak);
	}
	return largest;
}

/* ---- half a block ---- */

/* bound_row() behind a LayerNorm, whose rows are of length sqrt(D). */
static double bound_normed(const struct build *build, const struct dvsm_fixed_matrix *matrix,
			   size_t row)
{
	return bound_row(build, matrix, row, sqrt((double)build->model->config.dim));
}

/* One fraction for all numbers of a head, and its epsilon. */
static void set_head(const struct build *build, const struct dvsm_fixed_matrix *matrix, size_t head,
		     int64_t *epsilon)
{
	const struct dvsm_model_config *config = &build->model->config;
	size_t width = config->dim / config->heads, first = head * width;
	double bound = 0;

	for (size_t j = first; j < first + width; j++)
		bound = fmax(bound, bound_normed(build, matrix, j));

	int fraction = dvsm_fixed_fraction(bound, 32767);

	for (size_t j = first; j < first + width; j++)
		set_fraction(matrix, j, fraction);
	*epsilon = dvsm_fixed_quantise_epsilon((double)width * config->norm_eps, 2 * fraction);
}

static void take_query(struct build *build, const struct dvsm_fixed_place *place,
		       struct dvsm_fixed_half *half)
{
	const struct dvsm_model_config *config = &build->model->config;
	int64_t *epsilon = dvsm_arena_take(&build->arena, config->heads, sizeof(*epsilon));

	half->query = take_matrix(build, place);
	if (!filling(build))
		return;
	for (size_t h = 0; h < config->heads; h++)
		set_head(build, &half->query, h, &epsilon[h]);
	half->query_epsilon = epsilon;
}

/* Keys and values. Returns the length that a row of attention's output cannot exceed. */
static double take_key_value(struct build *build, const struct dvsm_half_weights *w,
			     const struct dvsm_fixed_place *place, struct dvsm_fixed_half *half)
{
	const struct dvsm_model_config *config = &build->model->config;
	const size_t dim = config->dim, width = dim / config->heads;
	int64_t *epsilon = dvsm_arena_take(&build->arena, config->heads, sizeof(*epsilon));
	int16_t *fractions = dvsm_arena_take(&build->arena, dim, sizeof(*fractions));
	struct dvsm_fixed_scale *qk = dvsm_arena_take(&build->arena, width, sizeof(*qk));
	double squares = 0;

	half->key_value = take_matrix(build, place);
	if (!filling(build))
		return 0;
	for (size_t h = 0; h < config->heads; h++)
		set_head(build, &half->key_value, h, &epsilon[h]);

	half->mixed_fraction = 64;
	for (size_t d = 0; d < dim; d++) {
		double bound = bound_normed(build, &half->key_value, dim + d);

		squares += bound * bound;
		fractions[d] = (int16_t)dvsm_fixed_fraction(bound, 32000);
		set_fraction(&half->key_value, dim + d, fractions[d]);
		if (fractions[d] < half->mixed_fraction)
			half->mixed_fraction = fractions[d];
	}
	for (size_t d = 0; d < width; d++)
		qk[d] = dvsm_fixed_scale_near((double)w->q_norm[d] * w->k_norm[d]);
	half->key_epsilon = epsilon;
	half->value_fraction = fractions;
	half->qk_weight = qk;
	return SLACK * sqrt(squares);
}

/* A product whose result joins the residual stream: the stream's bound grows by what it can add. */
static struct dvsm_fixed_matrix take_residual(struct build *build,
					      const struct dvsm_fixed_place *place, double length)
{
	struct dvsm_fixed_matrix matrix = take_matrix(build, place);
	double largest = 0;

	if (!filling(build))
		return matrix;
	for (size_t j = 0; j < matrix.out; j++)
		largest = fmax(largest, bound_row(build, &matrix, j, length));
	build->stream += largest;
	return matrix;
}

/* Returns the length that a row of hidden numbers cannot exceed. */
static double take_up(struct build *build, const struct dvsm_fixed_place *place,
		      struct dvsm_fixed_half *half)
{
	double squares = 0, largest = 0;

	half->up = take_matrix(build, place);
	if (!filling(build))
		return 0;
	for (size_t j = 0; j < half->up.out; j++) {
		double bound = bound_normed(build, &half->up, j);

		squares += bound * bound;
		largest = fmax(largest, bound);
	}
	half->hidden_fraction = dvsm_fixed_clamp(dvsm_fixed_fraction(largest, 32767), -32, 12);
	set_fractions(&half->up, half->hidden_fraction);
	return SLACK * sqrt(squares);
}

/* Which products of half a block take two planes of activations (FIXED_POINT.md, section 4). */
enum finesse { COARSE, FINE_BEHIND_ATTENTION, FINE_QUERIES };

static void take_half(struct build *build, const struct dvsm_half_weights *w, enum finesse finesse,
		      struct dvsm_fixed_half *half)
{
	struct dvsm_fixed_half_places places = dvsm_fixed_places_of(build->model, w);

	places.query.fine = finesse == FINE_QUERIES;
	places.out.fine = places.up.fine = places.down.fine = finesse == FINE_BEHIND_ATTENTION;

	half->norm = half->mlp_norm = build->unit;
	take_query(build, &places.query, half);
	half->out = take_residual(build, &places.out,
				  take_key_value(build, w, &places.key_value, half));
	half->down = take_residual(build, &places.down, take_up(build, &places.up, half));
}

/* ---- the whole ---- */

static void take_embedding(struct build *build, struct dvsm_fixed_model *fixed)
{
	const struct dvsm_weights *w = &build->model->weights;
	const struct dvsm_fixed_place ray = dvsm_fixed_place_plain(&w->patch_ray);
	const struct dvsm_fixed_place rgb = dvsm_fixed_place_plain(&w->patch_rgb);
	double bound;

	fixed->patch_ray = take_matrix(build, &ray);
	bound = filling(build) ? bound_sums(build, &fixed->patch_ray, RAY_PEAK) : 0;
	fixed->patch_rgb = take_matrix(build, &rgb);
	if (!filling(build))
		return;
	bound += bound_sums(build, &fixed->patch_rgb, COLOUR_PEAK);
	fixed->embed_fraction = dvsm_fixed_fraction(bound, 0x1p30);
	if (fixed->embed_fraction > MAX_EMBED_FRACTION)
		fixed->embed_fraction = MAX_EMBED_FRACTION;
	set_fractions(&fixed->patch_ray, fixed->embed_fraction);
	set_fractions(&fixed->patch_rgb, fixed->embed_fraction);
}

static void take_picture_ends(struct build *build, struct dvsm_fixed_model *fixed)
{
	const struct dvsm_weights *w = &build->model->weights;
	const struct dvsm_fixed_place place = dvsm_fixed_place_rgb(build->model);
	double largest = 0;

	take_embedding(build, fixed);
	build->stream = take_gain(build, w->embed_norm, &fixed->embed_norm);
	take_unit(build);
	fixed->final_norm = build->unit;
	fixed->to_rgb = take_matrix(build, &place);
	if (!filling(build))
		return;
	for (size_t j = 0; j < fixed->to_rgb.out; j++)
		largest = fmax(largest, bound_normed(build, &fixed->to_rgb, j));
	fixed->rgb_fraction = dvsm_fixed_fraction(largest, 0x1p29);
	if (fixed->rgb_fraction > MAX_RGB_FRACTION)
		fixed->rgb_fraction = MAX_RGB_FRACTION;
	set_fractions(&fixed->to_rgb, fixed->rgb_fraction);
}

/* The residual stream's binary point, once its bound is known, to all that meets it. */
static void set_stream_fraction(const struct build *build, struct dvsm_fixed_model *fixed)
{
	const struct dvsm_model_config *config = &build->model->config;
	double epsilon = config->dim * config->norm_eps;
	int fraction = dvsm_fixed_fraction(SLACK * build->stream, 0x1p30);

	fraction = fraction < MAX_STREAM_FRACTION ? fraction : MAX_STREAM_FRACTION;
	fixed->fraction = fraction;
	for (uint32_t i = 0; i < config->layers; i++) {
		struct dvsm_fixed_half *halves[2] = {&fixed->blocks[i].intra,
						     &fixed->blocks[i].cross};

		for (int h = 0; h < 2; h++) {
			int64_t fixed_epsilon = dvsm_fixed_quantise_epsilon(epsilon, 2 * fraction);

			halves[h]->norm.epsilon = fixed_epsilon;
			halves[h]->mlp_norm.epsilon = fixed_epsilon;
			set_fractions(&halves[h]->out, fraction);
			set_fractions(&halves[h]->down, fraction);
		}
	}
	fixed->final_norm.epsilon = dvsm_fixed_quantise_epsilon(epsilon, 2 * fraction);
	fixed->embed_norm.epsilon = dvsm_fixed_quantise_epsilon(epsilon, 2 * fixed->embed_fraction);
}

static void take_all(struct build *build, struct dvsm_fixed_model *fixed)
{
	const struct dvsm_model_config *config = &build->model->config;
	size_t width = config->dim / config->heads;
	struct dvsm_fixed_block *blocks =
		dvsm_arena_take(&build->arena, config->layers, sizeof(*blocks));
	struct dvsm_fixed_block scratch;

	fixed->blocks = blocks;
	take_picture_ends(build, fixed);
	for (uint32_t i = 0; i < config->layers; i++) {
		struct dvsm_fixed_block *block = blocks ? &blocks[i] : &scratch;

		take_half(build, &build->model->weights.blocks[i].intra,
			  i == 0 ? FINE_BEHIND_ATTENTION : COARSE, &block->intra);
		take_half(build, &build->model->weights.blocks[i].cross,
			  i == 0 ? FINE_QUERIES : COARSE, &block->cross);
	}
	if (!filling(build))
		return;
	fixed->root_head = dvsm_fixed_scale_near(sqrt((double)width));
	fixed->key_fraction = 14 - (dvsm_fixed_log2_up(width) + 1) / 2;
	set_stream_fraction(build, fixed);
}

/* The stream has one binary point: beside what the blocks may add, tokens must not vanish. */
static enum dvsm_status check_stream(const struct build *build,
				     const struct dvsm_fixed_model *fixed, struct dvsm_error *error)
{
	const size_t dim = build->model->config.dim;
	double squares = 0;

	for (size_t d = 0; d < dim; d++) {
		double weight = build->model->weights.embed_norm[d];

		squares += weight * weight;
	}

	double token = sqrt(squares / (double)dim);

	if (token == 0 || ldexp(token, fixed->fraction) >= 1 << LEAST_TOKEN_BITS ||
	    fixed->fraction == MAX_STREAM_FRACTION)
		return DVSM_OK;
	return dvsm_fail(error, DVSM_UNSUPPORTED,
			 "precision fixed: the blocks can add numbers of up to %.3g to tokens of "
			 "%.3g, which no 32 bits hold together: use f32 or bf16",
			 build->stream, token);
}

static enum dvsm_status check(const struct dvsm_model *model, struct dvsm_error *error)
{
	const struct dvsm_model_config *config = &model->config;
	size_t hidden = (size_t)config->dim * config->mlp_ratio;
	size_t patch = 6 * (size_t)config->patch_px * config->patch_px;
	size_t widest = hidden > patch ? hidden : patch;

	if (config->prior_dim > 0)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "the model has a prior of %u features, which this engine does not "
				 "compute: use a model without one",
				 config->prior_dim);
	if (widest > MOST_DEPTH)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "precision fixed takes matrices up to %u wide, the model has "
				 "one of %zu: use f32",
				 MOST_DEPTH, widest);
	return DVSM_OK;
}

/* Room for the largest matrix: the MLP's, keys and values, or one of the picture's ends. */
static bool take_scratch(struct build *build)
{
	const struct dvsm_model_config *config = &build->model->config;
	size_t pixels = (size_t)config->patch_px * config->patch_px;
	size_t hidden = (size_t)config->dim * config->mlp_ratio;
	size_t longest = hidden > 6 * pixels ? hidden : 6 * pixels;
	size_t most = longest > 2 * (size_t)config->dim ? longest : 2 * (size_t)config->dim;

	build->rows = malloc(most * config->dim * sizeof(*build->rows));
	build->numbers = malloc(most * config->dim);
	build->planes = malloc(2 * (hidden + DVSM_FIXED_DEPTH) * (config->dim + DVSM_FIXED_DEPTH));
	return build->rows && build->numbers && build->planes;
}

enum dvsm_status dvsm_fixed_model_create(const struct dvsm_model *model, struct dvsm_reader *reader,
					 struct dvsm_fixed_model **fixed, struct dvsm_error *error)
{
	struct build build = {.model = model, .reader = reader};
	struct dvsm_fixed_model *made = calloc(1, sizeof(*made));
	enum dvsm_status status = check(model, error);

	if (status != DVSM_OK || !made) {
		free(made);
		return status != DVSM_OK ? status
					 : dvsm_fail(error, DVSM_NO_MEM, "no memory for a model");
	}
	take_all(&build, made);
	made->weight_bytes = build.arena.used;
	made->memory = build.arena.overflow ? NULL : dvsm_aligned_alloc(build.arena.used);
	if (made->memory && take_scratch(&build)) {
		build.arena = (struct dvsm_arena){.base = made->memory};
		take_all(&build, made);
		status = check_stream(&build, made, error);
		if (status == DVSM_OK)
			*fixed = made;
		else
			dvsm_fixed_model_destroy(made);
	} else {
		dvsm_fixed_model_destroy(made);
		status = dvsm_fail(error, DVSM_NO_MEM, "no memory for %zu bytes of int8 weights",
				   build.arena.used);
	}
	free(build.rows);
	free(build.numbers);
	free(build.planes);
	return status;
}

void dvsm_fixed_model_destroy(struct dvsm_fixed_model *fixed)
{
	if (!fixed)
		return;
	free(fixed->memory);
	free(fixed);
}
