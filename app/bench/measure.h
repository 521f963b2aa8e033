/* One measurement: a precision, a stage patch, a number of views, a number of threads. */
#ifndef DIO_BENCH_MEASURE_H
#define DIO_BENCH_MEASURE_H

#include <stdbool.h>

#include "bench/work.h"

/** Most runs of a stage. */
#define DIO_RUNS_MAX 100u

/** What to measure, and how carefully. */
struct dio_measure {
	enum dvsm_precision precision;
	uint32_t cpu_mask;
	uint32_t patch_px, views, threads;
	uint32_t runs;              /* of each stage, after one that is not counted */
	const double *reference;    /* dio_work_read_reference(), or NULL */
	uint32_t reference_targets; /* how many of the first it holds */
};

/** Times of one stage over its runs. */
struct dio_times {
	uint32_t runs;
	double median_ms, best_ms, worst_ms;
	double low_ms, high_ms; /* quartiles */
	double operations;      /* of the matrix products and attention, each counted once */
};

/** How far what comes out is from what should, over all targets, numbers in [0,1]. */
struct dio_difference {
	bool known;
	double rms, largest;
};

struct dio_measured {
	struct dio_measure wish;
	char cpu[16];             /* tier in use */
	uint32_t threads, tokens; /* tokens of a target */
	struct dio_times reconstruct, render;
	struct dvsm_memory memory; /* what the engine planned and used */
	size_t peak_bytes;         /* of the whole process meanwhile; 0: the system does not say */
	struct dio_difference from_reference, from_truth; /* truth: the targets' pictures */
	double psnr_db; /* 8-bit pictures against true ones, mean over targets, when there are any
			 */
};

/**
 * Measure, with the work's model opened for the precision. A stage whose runs take long ends after
 * three of them.
 *
 * DIO_UNSUPPORTED  this build or model has no such precision
 */
enum dio_status dio_measure_run(struct dio_work *work, const struct dio_measure *wish,
				struct dio_measured *measured, struct dio_error *error);

/** Half the distance of the quartiles over the median. */
double dio_times_spread(const struct dio_times *times);

#endif
