#include "core/progress.h"

#include <stdio.h>
#include <unistd.h>

#include "dio/clock.h"

#define BAR_CELLS     32
#define SECOND_NS     1000000000u
#define REDRAW_NS     (SECOND_NS / 10)
#define LONG_ENOUGH_S 1.0

void dio_progress_init(struct dio_progress *progress, const char *title)
{
	*progress = (struct dio_progress){
		.title = title,
		.start_ns = dio_clock_ns(),
		.terminal = isatty(STDERR_FILENO) == 1,
	};
}

void dio_progress_update(struct dio_progress *progress, double done)
{
	uint64_t now = dio_clock_ns();
	double elapsed = (double)(now - progress->start_ns) * 1e-9;
	char bar[BAR_CELLS + 1];

	if (!progress->terminal || done < 0 || done > 1)
		return;
	if (progress->drawn && now - progress->drawn_ns < REDRAW_NS)
		return;
	/* Work that will be over within the second needs no bar. */
	if (!progress->drawn && elapsed < LONG_ENOUGH_S &&
	    (done <= 0 || elapsed < 0.2 || elapsed / done < LONG_ENOUGH_S))
		return;
	for (int i = 0; i < BAR_CELLS; i++)
		bar[i] = i < done * BAR_CELLS ? '#' : '.';
	bar[BAR_CELLS] = '\0';
	fprintf(stderr, "\r%s [%s] %3.0f %%  %.0f s\033[K", progress->title, bar, done * 100,
		elapsed);
	fflush(stderr);
	progress->drawn = true;
	progress->drawn_ns = now;
}

void dio_progress_done(struct dio_progress *progress)
{
	if (progress->drawn)
		fputs("\r\033[K", stderr);
	progress->drawn = false;
	progress->terminal = false;
}

bool dio_progress_engine(void *context, double done)
{
	dio_progress_update(context, done);
	return true;
}
