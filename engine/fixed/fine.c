#include "fixed/fine.h"

#include <string.h>

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

void dvsm_fixed_fine_weigh(int16_t *n, const int16_t *gain, size_t dim)
{
	for (size_t d = 0; d < dim; d++)
		n[d] = (int16_t)((n[d] * gain[d] + (1 << 14)) >> 15);
}

void dvsm_fixed_fine_keys(const int8_t *keys, size_t padded, size_t dim, int8_t *fine)
{
	const size_t numbers = DVSM_FIXED_PANEL * dvsm_fixed_pad(dim, DVSM_FIXED_HEAD);
	const size_t plane = DVSM_FIXED_PANEL * dvsm_fixed_fine_width(dim) / 2;

	for (size_t key = 0; key < padded; key += DVSM_FIXED_PANEL, keys += numbers) {
		memcpy(fine, keys, numbers);
		memset(fine + numbers, 0, plane - numbers);
		fine += plane;
		for (size_t i = 0; i < numbers; i++)
			fine[i] = dvsm_fixed_fine_low(keys[i]);
		memset(fine + numbers, 0, plane - numbers);
		fine += plane;
	}
}
