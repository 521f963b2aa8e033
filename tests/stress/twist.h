/* Adversarial weights: a random model's file, changed in memory before anyone opens it. */
#ifndef TESTS_STRESS_TWIST_H
#define TESTS_STRESS_TWIST_H

#include <stddef.h>

#include "dvsm/model.h"

/** One tensor of the file: the name without "blocks.N.", its numbers [rows][columns] (a vector has
 * one row). */
struct stress_tensor {
	const char *name;
	float *numbers;
	size_t rows, columns;
};

/** What is done to each tensor; `amount` says how strongly. */
typedef void stress_twist_fn(const struct dvsm_model_config *config,
			     const struct stress_tensor *tensor, double amount);

/** Walk an F32 model file's tensors; exits with a line when it is not one. */
void stress_twist_file(unsigned char *bytes, size_t size, const struct dvsm_model_config *config,
		       stress_twist_fn *twist, double amount);

/** Three channels of the residual stream `amount` times as large as the others: everything that
 * writes to them. */
stress_twist_fn stress_twist_outlier_channels;

/** The same for three channels of every value, in one head. */
stress_twist_fn stress_twist_outlier_values;

/** Weights of all LayerNorms times `amount`. */
stress_twist_fn stress_twist_norms;

/** Weights of all LayerNorms spread between 1/amount and amount, channel by channel. */
stress_twist_fn stress_twist_uneven_norms;

/** Weights of both QK-norms so that a score of two aligned vectors is `amount`. */
stress_twist_fn stress_twist_scores;

/** Keys that are all alike up to a part of 1/amount: what tells them apart is small. */
stress_twist_fn stress_twist_equal_keys;

/** Keys before QK-norm of size 1/amount: the norm's epsilon decides. */
stress_twist_fn stress_twist_tiny_keys;

/** All matrices times `amount`. */
stress_twist_fn stress_twist_matrices;

/** Every weight 0: nothing but epsilons to divide by. */
stress_twist_fn stress_twist_zero;

#endif
