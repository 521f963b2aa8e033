/* What the tests of app/ share: a scratch folder, small scenes, and running the real program. */
#ifndef TESTS_APP_FIXTURE_H
#define TESTS_APP_FIXTURE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#define FIXTURE_PATH_SIZE 1024

/** A folder of its own per test program, removed with all that is in it. Group set-up and
 * tear-down. */
int fixture_setup(void **state);
int fixture_teardown(void **state);

/** "SCRATCH/name", in a ring of buffers that holds the last 16. */
const char *fixture_path(const char *name);

/** Write text; folders on the way are made. */
void fixture_write(const char *name, const char *text);

/** Write a picture of one colour gradient. */
void fixture_write_picture(const char *name, uint32_t width, uint32_t height);

/** A file of the shared data, or NULL when it is absent (the caller skips and says so). */
const char *fixture_shared(const char *name);

/** What a program left: exit code (-1: killed by a signal), and its two outputs. */
struct fixture_run {
	int code;
	char out[65536], err[65536];
};

/** Run build/bin/diorama (first argument behind it; NULL ends the list). */
void fixture_diorama(struct fixture_run *run, ...);

/** Run any program found by PATH. */
void fixture_program(struct fixture_run *run, const char *program, ...);

/** Fail unless the run ended with `code` and said exactly one line on stderr holding all `words`.
 */
void fixture_expect_refusal(const struct fixture_run *run, int code, const char *words);

#endif
