#include "fixed/turn.h"

int dvsm_fixed_turn_stages(size_t count)
{
	int stages = 0;

	for (; count > 0 && count % 4 == 0; count /= 4)
		stages++;
	return stages;
}

void dvsm_fixed_turn(double *numbers, size_t count, size_t width)
{
	for (size_t step = 1; count % (4 * step) == 0; step *= 4) {
		for (size_t i = 0; i < count; i++) {
			if (i / step % 4 != 0)
				continue;

			double *a = numbers + i * width, *b = a + step * width;
			double *c = b + step * width, *d = c + step * width;

			for (size_t n = 0; n < width; n++) {
				double half = ((a[n] + b[n]) + (c[n] + d[n])) * 0.5;

				a[n] = half - a[n];
				b[n] = half - b[n];
				c[n] = half - c[n];
				d[n] = half - d[n];
			}
		}
	}
}

/* G of `count` times four numbers, whose firsts, seconds, thirds and fourths lie together. */
static void turn_fours(int32_t *restrict a, int32_t *restrict b, int32_t *restrict c,
		       int32_t *restrict d, size_t count)
{
	for (size_t i = 0; i < count; i++) {
		int32_t sum = a[i] + b[i] + c[i] + d[i];

		a[i] = sum - 2 * a[i];
		b[i] = sum - 2 * b[i];
		c[i] = sum - 2 * c[i];
		d[i] = sum - 2 * d[i];
	}
}

void dvsm_fixed_turn_integers(int32_t *numbers, size_t count)
{
	/* The first stage is apart from the others as its fours are in a row: so compilers make
	 * vectors of both. */
	for (size_t i = 0; count % 4 == 0 && i < count; i += 4) {
		int32_t *four = numbers + i, sum = four[0] + four[1] + four[2] + four[3];

		for (size_t k = 0; k < 4; k++)
			four[k] = sum - 2 * four[k];
	}
	for (size_t step = 4; count % (4 * step) == 0; step *= 4) {
		for (size_t i = 0; i < count; i += 4 * step) {
			int32_t *a = numbers + i;

			turn_fours(a, a + step, a + 2 * step, a + 3 * step, step);
		}
	}
}

static void turn_rows(double *rows, size_t out, size_t in, size_t part)
{
	for (size_t i = 0; i < out * in; i += part)
		dvsm_fixed_turn(rows + i, part, 1);
}

void dvsm_fixed_turn_matrix(const struct dvsm_fixed_place *place, double *rows)
{
	const struct dvsm_matrix *matrix = place->matrix;
	const size_t out = matrix->out, in = matrix->in, first = place->first_value;

	for (size_t j = 0; j < out; j++) {
		const float *panel =
			matrix->panels + j / DVSM_PANEL * DVSM_PANEL * in + j % DVSM_PANEL;

		for (size_t d = 0; d < in; d++)
			rows[j * in + d] = (double)panel[d * DVSM_PANEL] *
					   (place->gain ? (double)place->gain[d] : 1.0);
	}
	if (place->turned)
		return;
	if (place->in != DVSM_FIXED_PLAIN)
		turn_rows(rows, out, in, place->in == DVSM_FIXED_STREAM ? in : place->head);
	if (place->out == DVSM_FIXED_STREAM)
		dvsm_fixed_turn(rows, out, in);
	for (size_t j = first; place->out == DVSM_FIXED_VALUES && j < out; j += place->head)
		dvsm_fixed_turn(rows + j * in, place->head, in);
}

struct dvsm_fixed_half_places dvsm_fixed_places_of(const struct dvsm_model *model,
						   const struct dvsm_half_weights *half)
{
	const size_t dim = model->config.dim, head = dim / model->config.heads;
	const bool turned = model->turned;

	return (struct dvsm_fixed_half_places){
		.query = {.matrix = &half->query,
			  .gain = half->norm,
			  .in = DVSM_FIXED_STREAM,
			  .out = DVSM_FIXED_PLAIN,
			  .head = head,
			  .turned = turned},
		.key_value = {.matrix = &half->key_value,
			      .gain = half->norm,
			      .in = DVSM_FIXED_STREAM,
			      .out = DVSM_FIXED_VALUES,
			      .head = head,
			      .first_value = dim,
			      .turned = turned},
		.out = {.matrix = &half->out,
			.in = DVSM_FIXED_VALUES,
			.out = DVSM_FIXED_STREAM,
			.head = head,
			.turned = turned},
		.up = {.matrix = &half->up,
		       .gain = half->mlp_norm,
		       .in = DVSM_FIXED_STREAM,
		       .out = DVSM_FIXED_PLAIN,
		       .head = head,
		       .turned = turned},
		.down = {.matrix = &half->down,
			 .in = DVSM_FIXED_PLAIN,
			 .out = DVSM_FIXED_STREAM,
			 .head = head,
			 .turned = turned},
	};
}

struct dvsm_fixed_place dvsm_fixed_place_plain(const struct dvsm_matrix *matrix)
{
	return (struct dvsm_fixed_place){.matrix = matrix};
}

struct dvsm_fixed_place dvsm_fixed_place_rgb(const struct dvsm_model *model)
{
	return (struct dvsm_fixed_place){
		.matrix = &model->weights.to_rgb,
		.gain = model->weights.final_norm,
		.in = DVSM_FIXED_STREAM,
		.turned = model->turned,
	};
}
