/* Run time against error as a picture: SVG, readable on white and on dark pages. */
#ifndef DIO_BENCH_PLOT_H
#define DIO_BENCH_PLOT_H

#include "bench/report.h"

/**
 * Draw rendering's time against the error with the most threads measured: one panel for the
 * distance from float64, one for that from the true pictures, each where it is known. Points are
 * labelled with stage patch and views, coloured by precision; a line joins those that no other
 * point beats in both (the Pareto front). Both axes are logarithmic.
 *
 * DIO_BAD_ARG  neither distance is known
 */
enum dio_status dio_plot_write(const struct dio_report *report, const struct dio_outcome *outcome,
			       const char *path, struct dio_error *error);

#endif
