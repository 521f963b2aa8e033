#include "fixed/fine.h"

void dvsm_fixed_fine_join(const int8_t *high, const int8_t *low, size_t plane, int8_t *planes)
{
	for (size_t i = 0; i < plane; i++) {
		int16_t wide = (int16_t)(high[i] * 256 + low[i]);
		int16_t top = (int16_t)((int16_t)(wide + 64) >> 7);

		top = top < 127 ? top : 127;
		planes[i] = (int8_t)top;
		planes[plane + i] = (int8_t)((int16_t)(wide - top * 128 + 4) >> 3);
	}
}
