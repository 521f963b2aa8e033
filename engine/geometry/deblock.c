#include "geometry/deblock.h"

#include <stddef.h>

#include "geometry/pose.h"

#define NUMBER float
#define EXCESS float
#define WEIGHT float

static float excess_of(float p1, float p0, float q0, float q1)
{
	return 3 * (q0 - p0) + (p1 - q1);
}

static float weight_of(uint32_t i, uint32_t reach)
{
	return (float)(2 * reach - 2 * i - 1) / (float)(8 * reach);
}

static void move(float *to, float excess, float weight)
{
	*to += weight * excess;
}

#include "geometry/deblock.inc.h"

void dvsm_deblock_row(const struct dvsm_patch_plan *plan, float *patches, uint32_t row)
{
	even_out_row(plan, patches, row);
}

void dvsm_deblock_seam(const struct dvsm_patch_plan *plan, float *patches, uint32_t row)
{
	even_out_seam(plan, patches, row);
}
