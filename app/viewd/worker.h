/* A thread that takes jobs in turn, beside an event loop that must not wait. */
#ifndef DIO_VIEWD_WORKER_H
#define DIO_VIEWD_WORKER_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/status.h"

/**
 * A job; usually the first member of a larger struct. It is the worker's from dio_worker_post()
 * until `done` is called, and whoever made it releases it there.
 *
 * run    on the worker's thread; its result goes to `status` and `error`
 * done   on the loop's thread, from dio_worker_dispatch()
 */
struct dio_job {
	enum dio_status (*run)(struct dio_job *job, struct dio_error *error);
	void (*done)(struct dio_job *job);
	void *owner;
	enum dio_status status;
	struct dio_error error;
	struct dio_job *next;
};

/** Opaque; every function is for the loop's thread. */
struct dio_worker;

/** `name` is the thread's, at most 15 letters. */
enum dio_status dio_worker_create(const char *name, struct dio_worker **worker,
				  struct dio_error *error);

/**
 * Waits for the job that runs, then ends the thread. Jobs that were not begun get done() with the
 * status DIO_END. NULL is fine.
 */
void dio_worker_destroy(struct dio_worker *worker);

void dio_worker_post(struct dio_worker *worker, struct dio_job *job);

/** Readable when dio_worker_dispatch() has a done() to call. */
int dio_worker_get_fd(const struct dio_worker *worker);
void dio_worker_dispatch(struct dio_worker *worker);

/** Jobs posted whose done() was not called yet. */
uint32_t dio_worker_get_pending(const struct dio_worker *worker);

#endif
