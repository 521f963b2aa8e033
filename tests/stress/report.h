/* What the stress test measured: a line each as it comes, all of it as JSON at the end. */
#ifndef TESTS_STRESS_REPORT_H
#define TESTS_STRESS_REPORT_H

#include <stdbool.h>
#include <stddef.h>

enum stress_judgement {
	STRESS_AT_MOST,  /* good when value <= limit */
	STRESS_AT_LEAST, /* good when value >= limit */
	STRESS_STATED,   /* for the reader; fails only when it is not a number */
};

/** One measured number. Texts are copied, and cut when they are long. */
struct stress_figure {
	const char *group;     /* "extremes", "growth", "invariants", "loop" */
	const char *name;      /* what was done: "outlier channels x100" */
	const char *precision; /* "f32" */
	const char *what;      /* what the number is: "relative error" */
	enum stress_judgement judgement;
	double value, limit;
};

/** Opaque. */
struct stress_report;

struct stress_report *stress_report_make(void);
void stress_report_free(struct stress_report *report);

/** Keep a figure and print it. */
void stress_report_add(struct stress_report *report, const struct stress_figure *figure);

/** Keep a fault that is no number - a call that was refused, say - and print it. */
void stress_report_fault(struct stress_report *report, const struct stress_figure *about,
			 const char *fault);

/** Print each failure once more, and how many there were of how many. */
void stress_report_summarise(const struct stress_report *report);

size_t stress_report_get_failures(const struct stress_report *report);

/** All figures as a JSON array; false with a printed line when the file cannot be written. */
bool stress_report_write(const struct stress_report *report, const char *path);

#endif
