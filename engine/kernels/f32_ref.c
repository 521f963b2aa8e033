/* The float32 specification. */
#include "kernels/kernels.h"

typedef float number;

static float widen(number x)
{
	return x;
}

static number narrow(double x)
{
	return (float)x;
}

static double round_weight(double x)
{
	return x;
}

static size_t panel_place(size_t row, size_t d, size_t depth)
{
	return (row / DVSM_PANEL * depth + d) * DVSM_PANEL + row % DVSM_PANEL;
}

#include "kernels/ref.inc.h"

const struct dvsm_kernels dvsm_kernels_scalar = {
	.cpu = DVSM_CPU_SCALAR,
	.name = "scalar",
	DVSM_KERNEL_FUNCTIONS,
};
