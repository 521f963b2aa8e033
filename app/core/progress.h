/* A progress bar on a terminal for work longer than a second; silent elsewhere. */
#ifndef DIO_APP_PROGRESS_H
#define DIO_APP_PROGRESS_H

#include <stdbool.h>
#include <stdint.h>

/** Caller's memory; dio_progress_init() readies it. Thread-bound. */
struct dio_progress {
	const char *title;
	uint64_t start_ns, drawn_ns;
	bool terminal, drawn;
};

/** `title` is borrowed until dio_progress_done(). */
void dio_progress_init(struct dio_progress *progress, const char *title);

/** Share done in [0,1]. Draws at most ten times a second, and only when the work looks long. */
void dio_progress_update(struct dio_progress *progress, double done);

/** Wipe the bar. */
void dio_progress_done(struct dio_progress *progress);

/** A dvsm_progress_fn: `context` is a struct dio_progress. Never cancels. */
bool dio_progress_engine(void *context, double done);

#endif
