/* Every precision x stage patch x number of views x number of threads that was asked for. */
#ifndef DIO_BENCH_SWEEP_H
#define DIO_BENCH_SWEEP_H

#include "bench/measure.h"
#include "bench/peak.h"

/** Longest list of one kind. */
#define DIO_SWEEP_MAX 16u

struct dio_list {
	uint32_t count;
	uint32_t values[DIO_SWEEP_MAX];
};

/**
 * Parse "4,8,16": whole numbers in [low, high], each once.
 *
 * name  the option, for the error's text
 */
enum dio_status dio_list_parse(const char *text, const char *name, uint32_t low, uint32_t high,
			       struct dio_list *list, struct dio_error *error);

/** Parse "f32,fixed" to values of enum dvsm_precision. */
enum dio_status dio_list_parse_precisions(const char *text, struct dio_list *list,
					  struct dio_error *error);

/** What is swept. */
struct dio_sweep {
	struct dio_list precisions, patches, views, threads;
	bool any_precision; /* one that is not to be had is left out instead of refused */
	uint32_t cpu_mask, runs;
	const char *reference; /* folder, or NULL */
};

/** All that came of a sweep. Release with dio_outcome_deinit(). */
struct dio_outcome {
	struct dio_peak peaks[DIO_SWEEP_MAX]; /* one a number of threads */
	uint32_t peak_count;
	struct dio_measured *measured;
	uint32_t count;
};

/** Called after each measurement. */
typedef void dio_sweep_fn(const void *context, const struct dio_outcome *outcome,
			  const struct dio_measured *measured);

/** Measure the machine, then everything; `said` is NULL or told of each. */
enum dio_status dio_sweep_run(struct dio_work *work, const struct dio_sweep *sweep,
			      dio_sweep_fn *said, const void *context, struct dio_outcome *outcome,
			      struct dio_error *error);
void dio_outcome_deinit(struct dio_outcome *outcome);

/** The machine's peak with as many threads as a measurement used. */
const struct dio_peak *dio_outcome_peak(const struct dio_outcome *outcome,
					const struct dio_measured *measured);

#endif
