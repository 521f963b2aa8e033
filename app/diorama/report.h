/* Ways of saying things that several sub-commands share. */
#ifndef DIO_DIORAMA_REPORT_H
#define DIO_DIORAMA_REPORT_H

#include <cjson/cJSON.h>

#include "core/session.h"

/** The line of a failure on standard error; returns DIO_EXIT_FAILED. */
int dio_report_failure(const char *command, const struct dio_error *error);

/** "12.3 MiB" and the like; the buffer is the caller's. */
const char *dio_report_bytes(size_t bytes, char *text, size_t size);

/** Weights, cache and workspace, in bytes, as members of a new object. */
cJSON *dio_report_memory(const struct dvsm_memory *memory);

/** A line "model NAME, avx512, 2 threads" for people. */
void dio_report_engine(const struct dio_session *session);

#endif
