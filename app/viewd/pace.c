#include "viewd/pace.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PATCH_MAX_PX 256u
#define SPARE        0.8 /* of the budget: what a finer rung may be expected to take */

/* Tokens of a picture, as the engine cuts it. */
static uint32_t count_tokens(uint32_t width, uint32_t height, uint32_t patch_px)
{
	double columns = fmax(1, floor((double)width / patch_px + 0.5));
	double rows = fmax(1, floor((double)height / patch_px + 0.5));

	return (uint32_t)(columns * rows);
}

void dio_pace_init(struct dio_pace *pace, uint32_t width, uint32_t height, uint32_t patch_px,
		   uint64_t budget_ns)
{
	static const double STEPS[DIO_PACE_RUNGS] = {1, 1.25, 1.5, 2};

	*pace = (struct dio_pace){.budget_ns = budget_ns};
	for (int i = 0; i < DIO_PACE_RUNGS; i++) {
		uint32_t patch = (uint32_t)lround(patch_px * STEPS[i]), tokens;

		patch = patch < 1 ? 1 : patch > PATCH_MAX_PX ? PATCH_MAX_PX : patch;
		tokens = count_tokens(width, height, patch);
		if (pace->rungs > 0 && tokens >= pace->tokens[pace->rungs - 1])
			continue;
		pace->patch_px[pace->rungs] = patch;
		pace->tokens[pace->rungs++] = tokens;
	}
}

uint32_t dio_pace_get_patch(const struct dio_pace *pace)
{
	return pace->patch_px[pace->rung];
}

static int compare(const void *a, const void *b)
{
	uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

	return (x > y) - (x < y);
}

static void step_to(struct dio_pace *pace, uint32_t rung)
{
	pace->rung = rung;
	pace->count = 0;
}

void dio_pace_note(struct dio_pace *pace, uint64_t render_ns)
{
	uint64_t sorted[DIO_PACE_SAMPLES];
	double median;

	pace->samples_ns[pace->count % DIO_PACE_SAMPLES] = render_ns;
	pace->count++;
	if (pace->count < DIO_PACE_SAMPLES)
		return;
	memcpy(sorted, pace->samples_ns, sizeof sorted);
	qsort(sorted, DIO_PACE_SAMPLES, sizeof *sorted, compare);
	median = (double)sorted[DIO_PACE_SAMPLES / 2];
	if (median > (double)pace->budget_ns && pace->rung + 1 < pace->rungs) {
		step_to(pace, pace->rung + 1);
	} else if (pace->rung > 0) {
		/* Time goes with the tokens: all layers but the intra-view scores do. */
		double finer = median * pace->tokens[pace->rung - 1] / pace->tokens[pace->rung];

		if (finer < SPARE * (double)pace->budget_ns)
			step_to(pace, pace->rung - 1);
	}
}
