/*
 * What the checks of the float32 and the bfloat16 kernels share: how sizes and numbers are drawn,
 * how far two numbers may lie apart, and what a product is.
 */
#ifndef TESTS_KERNELS_FLOAT_CHECKS_H
#define TESTS_KERNELS_FLOAT_CHECKS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "kernels/kernels.h"
#include "support/guarded.h"
#include "support/random.h"

#define ROUNDING     0x1p-24
#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static struct support_random rng;

/* One of `sizes` that is below that. */
static inline size_t draw_size(const size_t *sizes, size_t count, size_t below)
{
	size_t value;

	do {
		value = sizes[support_random_below(&rng, count)];
	} while (value >= below);
	return value;
}

static inline struct support_guarded fill(size_t count, float scale)
{
	struct support_guarded made = support_guarded_make(count);

	assert_non_null(made.data);
	support_random_fill(&rng, made.data, count, scale);
	return made;
}

static inline void expect_near(const char *tier, const char *what, size_t at, double got,
			       double want, double tolerance)
{
	if (got == want || fabs(got - want) <= tolerance)
		return;
	fail_msg("%s %s [%zu]: %.9g, the specification says %.9g, tolerance %.2g", tier, what, at,
		 got, want, tolerance);
}

struct gemm_shape {
	size_t rows, cols, depth, a_stride, c_stride;
	enum dvsm_epilogue epilogue;
	float scale;
};

static inline double gelu_of(double x)
{
	return 0.5 * x * erfc(-x * M_SQRT1_2);
}

#endif
