/* One line of error text and the status that goes with it. */
#ifndef DVSM_BASE_ERROR_H
#define DVSM_BASE_ERROR_H

#include "dvsm/status.h"

/**
 * Write one line into `error` (NULL is fine) and yield `status`, so that a function can end with
 * `return dvsm_fail(error, DVSM_BAD_ARG, "view %u: ...", i);`. A macro, so that compilers and
 * analysers see which status comes back.
 */
#define dvsm_fail(error, status, ...) (dvsm_error_write(error, __VA_ARGS__), (status))

/** The text alone. Control characters, which a broken file may bring in by a name, become '?'. */
__attribute__((format(printf, 2, 3))) void dvsm_error_write(struct dvsm_error *error,
							    const char *format, ...);

/** The end of a file's name that leaves room for the fault in an error's one line. */
const char *dvsm_name_tail(const char *name);

#endif
