#include "fixed/deblock.h"

#include <stddef.h>

#include "fixed/picture.h"
#include "geometry/pose.h"
#include "kernels/fixed_math.h"

#define NUMBER int32_t
#define EXCESS int64_t
#define WEIGHT int32_t

static int64_t excess_of(int32_t p1, int32_t p0, int32_t q0, int32_t q1)
{
	return 3 * ((int64_t)q0 - p0) + ((int64_t)p1 - q1);
}

/* Rounded, halves up. */
static int32_t weight_of(uint32_t i, uint32_t reach)
{
	return (int32_t)((((2 * reach - 2 * i - 1) << 14) + reach) / (2 * reach));
}

static void move(int32_t *to, int64_t excess, int32_t weight)
{
	const int64_t moved = *to + dvsm_fixed_round(excess * weight, 16);

	*to = (int32_t)(moved < -DVSM_FIXED_COLOUR_LIMIT  ? -DVSM_FIXED_COLOUR_LIMIT
			: moved > DVSM_FIXED_COLOUR_LIMIT ? DVSM_FIXED_COLOUR_LIMIT
							  : moved);
}

#include "geometry/deblock.inc.h"

void dvsm_fixed_deblock_row(const struct dvsm_patch_plan *plan, int32_t *patches, uint32_t row)
{
	even_out_row(plan, patches, row);
}

void dvsm_fixed_deblock_seam(const struct dvsm_patch_plan *plan, int32_t *patches, uint32_t row)
{
	even_out_seam(plan, patches, row);
}
