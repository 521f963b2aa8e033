#include "base/memory.h"
#include "kernels/kernels.h"

bool dvsm_pack_size(size_t rows, size_t depth, size_t *floats)
{
	size_t padded;

	if (!dvsm_size_add(rows, DVSM_PANEL - 1, &padded))
		return false;
	return dvsm_size_mul(padded / DVSM_PANEL * DVSM_PANEL, depth, floats);
}

void dvsm_pack_panels(const float *weights, size_t rows, size_t depth, float *panels)
{
	for (size_t first = 0; first < rows; first += DVSM_PANEL) {
		for (size_t d = 0; d < depth; d++) {
			for (size_t j = 0; j < DVSM_PANEL; j++) {
				size_t row = first + j;

				*panels++ = row < rows ? weights[row * depth + d] : 0.0f;
			}
		}
	}
}
