#include "viewd/figures.h"

#include <stdlib.h>
#include <string.h>

#define RATE_SPAN_NS 1500000000u

void dio_figures_note(struct dio_figures *figures, uint64_t taken_ns, uint64_t shown_ns)
{
	figures->shown_ns[figures->shown++ % DIO_FIGURES_WINDOW] = shown_ns;
	if (taken_ns == 0 || taken_ns > shown_ns)
		return;
	figures->latency_ns[figures->timed++ % DIO_FIGURES_WINDOW] = shown_ns - taken_ns;
}

static int compare(const void *a, const void *b)
{
	uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

	return (x > y) - (x < y);
}

void dio_figures_get_latency(const struct dio_figures *figures, double *median_ms, double *p99_ms)
{
	uint64_t sorted[DIO_FIGURES_WINDOW];
	size_t count = figures->timed < DIO_FIGURES_WINDOW ? figures->timed : DIO_FIGURES_WINDOW;

	*median_ms = *p99_ms = 0;
	if (count == 0)
		return;
	memcpy(sorted, figures->latency_ns, count * sizeof *sorted);
	qsort(sorted, count, sizeof *sorted, compare);
	*median_ms = (double)sorted[count / 2] * 1e-6;
	*p99_ms =
		(double)sorted[(count * 99) / 100 < count ? (count * 99) / 100 : count - 1] * 1e-6;
}

double dio_figures_get_rate(const struct dio_figures *figures, uint64_t now_ns)
{
	uint64_t first = now_ns, last = 0;
	uint32_t count = 0;

	for (uint64_t i = 1; i <= figures->shown && i <= DIO_FIGURES_WINDOW; i++) {
		uint64_t at = figures->shown_ns[(figures->shown - i) % DIO_FIGURES_WINDOW];

		if (at + RATE_SPAN_NS < now_ns)
			break;
		last = last ? last : at;
		first = at;
		count++;
	}
	return count < 2 || last <= first ? 0 : (count - 1) / ((double)(last - first) * 1e-9);
}

void dio_figures_clear(struct dio_figures *figures)
{
	*figures = (struct dio_figures){0};
}
