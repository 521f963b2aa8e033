/* The bfloat16 specification. */
#include <math.h>

#include "kernels/bf16.h"
#include "kernels/kernels.h"

typedef dvsm_bf16 number;

static float widen(number x)
{
	return dvsm_bf16_widen(x);
}

/* One rounding: to float towards the side that breaks no tie that is not there ("to odd"). */
static number narrow(double x)
{
	float near = (float)x;
	uint32_t bits;

	if (near != x && fabsf(near) < INFINITY) {
		memcpy(&bits, &near, sizeof(bits));
		if (fabs((double)near) > fabs(x))
			bits--;
		bits |= 1;
		memcpy(&near, &bits, sizeof(near));
	}
	return dvsm_bf16_round(near);
}

static double round_weight(double x)
{
	return widen(narrow(x));
}

static size_t panel_place(size_t row, size_t d, size_t depth)
{
	return dvsm_bf16_place(row, d, depth);
}

#include "kernels/ref.inc.h"

const struct dvsm_kernels dvsm_kernels_bf16_scalar = {
	.cpu = DVSM_CPU_SCALAR,
	.name = "scalar",
	DVSM_KERNEL_FUNCTIONS,
};
