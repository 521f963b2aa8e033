/* Turning the residual stream and the values, so that no channel stands out. Private. */
#ifndef DVSM_FIXED_TURN_H
#define DVSM_FIXED_TURN_H

#include <stddef.h>
#include <stdint.h>

#include "model/model.h"

/**
 * x = Q x in place. Q works on blocks of n numbers, n the largest power of four that divides count:
 * it is the k-fold Kronecker product, n = 4^k, of G = J/2 - I, J all ones. Q is symmetric and its
 * own inverse, its numbers are +-1/sqrt(n), and it leaves a vector of equal numbers as it is - so a
 * LayerNorm without a weight commutes with it. With an odd count, or twice an odd one, Q = I.
 *
 * numbers   [count][width]: `width` vectors at once
 */
void dvsm_fixed_turn(double *numbers, size_t count, size_t width);

/** k: dvsm_fixed_turn_integers() gives 2^k Q x. */
int dvsm_fixed_turn_stages(size_t count);

/** x = 2^k Q x in place, exact where 4^k |x| fits. */
void dvsm_fixed_turn_integers(int32_t *numbers, size_t count);

/** On which side of a matrix what is turned. */
enum dvsm_fixed_side {
	DVSM_FIXED_PLAIN,  /* rays, colours, queries, keys, hidden numbers */
	DVSM_FIXED_STREAM, /* the residual stream: D numbers at once */
	DVSM_FIXED_VALUES, /* attention's output: D/h numbers at once */
};

/** A matrix and its surroundings. */
struct dvsm_fixed_place {
	const struct dvsm_matrix *matrix;
	const float *gain; /* weight of the norm before it, which becomes part of it; or NULL */
	enum dvsm_fixed_side in, out;
	size_t head;        /* D/h */
	size_t first_value; /* with out VALUES, the rows from here on; those before are plain */
	bool turned;        /* the model's weights already are */
	bool fine;          /* its input comes in two planes */
};

/** The rows of the turned matrix, [out][in], a gain in them. */
void dvsm_fixed_turn_matrix(const struct dvsm_fixed_place *place, double *rows);

/** Places of a model's matrices; `turned` is the model's. */
struct dvsm_fixed_half_places {
	struct dvsm_fixed_place query, key_value, out, up, down;
};
struct dvsm_fixed_half_places dvsm_fixed_places_of(const struct dvsm_model *model,
						   const struct dvsm_half_weights *half);
struct dvsm_fixed_place dvsm_fixed_place_plain(const struct dvsm_matrix *matrix);
struct dvsm_fixed_place dvsm_fixed_place_rgb(const struct dvsm_model *model);

#endif
