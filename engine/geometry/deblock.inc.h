/*
 * The walk along seams, for one type of number. Before inclusion are defined:
 *
 *   NUMBER                              a colour
 *   EXCESS                              of a step
 *   WEIGHT                              of a pixel
 *   excess_of(p1, p0, q0, q1)           2 e of deblock.h
 *   weight_of(i, reach)                 of pixel i from the seam: (2 reach - 2 i - 1) / (8 reach)
 *   move(NUMBER *to, excess, weight)    *to += weight excess
 */

struct seams {
	uint32_t side, reach;
	size_t run, patch, below; /* numbers of a patch's line, a patch, a row of patches */
	WEIGHT weights[DVSM_MAX_PATCH_PX / 2];
};

static struct seams seams_of(const struct dvsm_patch_plan *plan)
{
	struct seams seams = {.side = plan->patch_px};

	seams.reach = seams.side < DVSM_DEBLOCK_LEAST_PX ? 0 : seams.side / 2;
	seams.run = 3 * (size_t)seams.side;
	seams.patch = seams.side * seams.run;
	seams.below = plan->grid.columns * seams.patch;
	for (uint32_t i = 0; i < seams.reach; i++)
		seams.weights[i] = weight_of(i, seams.reach);
	return seams;
}

/* Across a seam: p is the last line before it, q the first behind, of `count` numbers each; a line
 * is `step` numbers from the next. */
static void even_out(const struct seams *seams, NUMBER *p, NUMBER *q, size_t step, size_t count)
{
	for (size_t k = 0; k < count; k++, p++, q++) {
		const EXCESS excess = excess_of(*(p - step), *p, *q, *(q + step));

		for (uint32_t i = 0; i < seams->reach; i++) {
			move(p - i * step, excess, seams->weights[i]);
			move(q + i * step, -excess, seams->weights[i]);
		}
	}
}

static void even_out_row(const struct dvsm_patch_plan *plan, NUMBER *patches, uint32_t row)
{
	const struct seams seams = seams_of(plan);
	NUMBER *p = patches + row * seams.below + seams.run - 3;

	if (seams.reach == 0)
		return;
	for (uint32_t column = 0; column + 1 < plan->grid.columns; column++)
		for (uint32_t y = 0; y < seams.side; y++, p += seams.run)
			even_out(&seams, p, p - (seams.run - 3) + seams.patch, 3, 3);
}

static void even_out_seam(const struct dvsm_patch_plan *plan, NUMBER *patches, uint32_t row)
{
	const struct seams seams = seams_of(plan);
	NUMBER *q = patches + (row + 1) * seams.below;

	if (seams.reach == 0)
		return;
	for (uint32_t column = 0; column < plan->grid.columns; column++, q += seams.patch)
		even_out(&seams, q - seams.below + seams.patch - seams.run, q, seams.run,
			 seams.run);
}
