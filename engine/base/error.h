/* One line of error text and the status that goes with it. */
#ifndef DVSM_BASE_ERROR_H
#define DVSM_BASE_ERROR_H

#include "dvsm/status.h"

/**
 * Write one line into `error` (NULL is fine) and return `status`, so that a function can end with
 * `return dvsm_fail(error, DVSM_BAD_ARG, "view %u: ...", i);`. Control characters, which a broken
 * file may bring in through a name, become '?'.
 */
__attribute__((format(printf, 3, 4))) enum dvsm_status
dvsm_fail(struct dvsm_error *error, enum dvsm_status status, const char *format, ...);

/** The end of a file's name that leaves room for the fault in an error's one line. */
const char *dvsm_name_tail(const char *name);

#endif
