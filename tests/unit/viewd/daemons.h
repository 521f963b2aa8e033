/* Both daemons as processes, on a private bus, with a camera made of rendered pictures. */
#ifndef TESTS_VIEWD_DAEMONS_H
#define TESTS_VIEWD_DAEMONS_H

#include "unit/app/fixture.h"

#include <sys/types.h>

/** Group set-up and tear-down: scratch folder, bus, profile, a tiny model, pictures. */
int daemons_setup(void **state);
int daemons_teardown(void **state);

/** The profile of the next daemon started; `reserve_mib` of the disk stay free. */
void daemons_write_profile(uint32_t reserve_mib, const char *deblock);

/** Start the capture daemon on "dance" or "walk" at a rate, or stop it. */
void daemons_start_camera(const char *pictures, double frames_per_second);
void daemons_stop_camera(void);

/** Start it on any source, such as "sim:table"; its process. */
pid_t daemons_start_source(const char *source, double frames_per_second);

/** Start the display daemon and wait until the bus has it. */
void daemons_start_viewer(void);
/** End it by a signal; its exit code, -1 when the signal killed it. */
int daemons_stop_viewer(int signal_number);
/** The same; the exit code must be 0. */
void daemons_end_viewer(int signal_number);
pid_t daemons_get_viewer(void);

/** Run `diorama ctl` with these words, which must go well. */
void daemons_ctl(const char *word, const char *argument);
/** Wait for PROPERTY=VALUE. */
void daemons_wait(const char *condition);
/** `diorama ctl` must refuse, in one line that has all `words`. */
void daemons_expect_refusal(const char *word, const char *words);
/** A property as text, good until the next call. */
const char *daemons_get(const char *property);
/** One of the capture daemon's. */
const char *daemons_get_capture(const char *property);

/** Where the web page is, with its token: "http://127.0.0.1:PORT/#TOKEN". */
const char *daemons_get_page(void);

/** What the display daemon printed, the last 16 KiB. */
const char *daemons_read_log(void);

#endif
