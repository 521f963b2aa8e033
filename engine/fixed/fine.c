#include "fixed/fine.h"

#include <string.h>

#include "kernels/fixed_math.h"

/* 16-bit lanes throughout: no sum leaves them. */
int dvsm_fixed_fine_split(const int16_t *x, size_t count, size_t plane, int8_t *planes)
{
	int16_t largest = 0, smallest = 0;
	int8_t *high = planes, *low = planes + plane;

	for (size_t i = 0; i < count; i++) {
		largest = x[i] > largest ? x[i] : largest;
		smallest = x[i] < smallest ? x[i] : smallest;
	}

	int size = largest > -smallest ? largest : -smallest;
	int up = 15 - dvsm_fixed_bits((uint64_t)(size < INT16_MAX ? size : INT16_MAX));

	for (size_t i = 0; i < count; i++) {
		int16_t wide = (int16_t)((uint16_t)x[i] << up);
		int16_t top = (int16_t)((int16_t)((wide >> 7) + 1) >> 1);

		top = top < 127 ? top : 127;
		high[i] = (int8_t)top;
		low[i] = (int8_t)((int16_t)(wide - top * 256 + 8) >> 4);
	}
	memset(high + count, 0, plane - count);
	memset(low + count, 0, plane - count);
	return up;
}

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
