#include "kernels/pack.h"

#include "base/memory.h"

bool dvsm_pack_size(size_t rows, size_t depth, size_t *floats)
{
	size_t padded;

	if (!dvsm_size_add(rows, DVSM_PANEL - 1, &padded))
		return false;
	return dvsm_size_mul(padded / DVSM_PANEL * DVSM_PANEL, depth, floats);
}

void dvsm_pack_pad(size_t rows, size_t depth, float *panels)
{
	size_t used = rows % DVSM_PANEL;

	if (used == 0)
		return;
	panels += (rows - used) * depth;
	for (size_t d = 0; d < depth; d++, panels += DVSM_PANEL) {
		for (size_t j = used; j < DVSM_PANEL; j++)
			panels[j] = 0.0f;
	}
}

void dvsm_pack_run(const float *numbers, size_t first, size_t count, size_t depth, float *panels)
{
	while (count > 0 && depth > 0) {
		size_t row = first / depth, d = first % depth;
		size_t run = count < depth - d ? count : depth - d;
		float *place =
			panels + (row / DVSM_PANEL * depth + d) * DVSM_PANEL + row % DVSM_PANEL;

		for (size_t i = 0; i < run; i++)
			place[i * DVSM_PANEL] = numbers[i];
		numbers += run;
		first += run;
		count -= run;
	}
}

void dvsm_pack_panels(const float *weights, size_t rows, size_t depth, float *panels)
{
	dvsm_pack_pad(rows, depth, panels);
	dvsm_pack_run(weights, 0, rows * depth, depth, panels);
}

bool dvsm_bf16_pack_size(size_t rows, size_t depth, size_t *numbers)
{
	size_t padded;

	return dvsm_size_add(depth, 31, &padded) && dvsm_pack_size(rows, padded / 32 * 32, numbers);
}

void dvsm_bf16_pack(const float *panels, size_t rows, size_t depth, dvsm_bf16 *pairs)
{
	for (size_t row = 0; row < rows; row += DVSM_PANEL) {
		for (size_t d = 0; d < dvsm_bf16_depth(depth); d++) {
			dvsm_bf16 *place = pairs + dvsm_bf16_place(row, d, depth);

			for (size_t j = 0; j < DVSM_PANEL; j++)
				place[2 * j] = d < depth ? dvsm_bf16_round(panels[j]) : 0;
			panels += d < depth ? DVSM_PANEL : 0;
		}
	}
}
