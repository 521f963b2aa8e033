/* A sweep's outcome for people and for programs. */
#ifndef DIO_BENCH_REPORT_H
#define DIO_BENCH_REPORT_H

#include <cjson/cJSON.h>

#include "bench/machine.h"
#include "bench/sweep.h"

/** What the figures are about: the heads of table, JSON and plot. */
struct dio_report {
	const struct dio_machine *machine;
	const struct dio_work *work;
	const struct dio_sweep *sweep;
};

/** The machine, its measured peaks, the work. */
void dio_report_print_head(const struct dio_report *report, const struct dio_outcome *outcome);

/** One line of the table; the column heads stand above the first. */
void dio_report_print_row(const struct dio_outcome *outcome, const struct dio_measured *measured);

/** Everything as one object; release with cJSON_Delete(). */
cJSON *dio_report_json(const struct dio_report *report, const struct dio_outcome *outcome);

/** Operations a second of a stage, and their share of the measured peak in [0,1]; NaN without. */
double dio_report_rate(const struct dio_times *times);
double dio_report_share(const struct dio_outcome *outcome, const struct dio_measured *measured,
			const struct dio_times *times);

#endif
