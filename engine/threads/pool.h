/*
 * A fixed set of threads that share the tasks of one job at a time. Private to the engine.
 *
 * A thread has its own run of a job's tasks, the same in every job of as many tasks, so that what
 * it wrote in one it finds in its cache in the next; when that is done it claims what others have
 * left, so a thread that the system took off its core delays only the task in its hands. Which
 * thread runs a task must not change the task's result. A thread polls until a job is done
 * and for some ten microseconds more, then it sleeps. A pool as large as the machine has each of
 * its own threads on a processor of its own.
 */
#ifndef DVSM_THREADS_POOL_H
#define DVSM_THREADS_POOL_H

#include <stddef.h>
#include <stdint.h>

#include "dvsm/status.h"

#define DVSM_MAX_THREADS 256u

struct dvsm_pool;

/**
 * One task of a job.
 *
 * index    0..count-1, each exactly once
 * worker   0..threads-1, never the same in two tasks at once: the index of a scratch area
 */
typedef void dvsm_task_fn(void *context, size_t index, uint32_t worker);

/** Processors that this process may run on, 1..DVSM_MAX_THREADS. */
uint32_t dvsm_pool_processors(void);

/**
 * Create a pool; the caller of dvsm_pool_run() is one of its threads, so 1 creates none.
 *
 * threads   1..DVSM_MAX_THREADS
 *
 * DVSM_NO_MEM  memory or threads ran out
 */
enum dvsm_status dvsm_pool_create(uint32_t threads, struct dvsm_pool **pool,
				  struct dvsm_error *error);

/** Stop and join the threads; NULL is fine. No job may be running. */
void dvsm_pool_destroy(struct dvsm_pool *pool);

uint32_t dvsm_pool_get_threads(const struct dvsm_pool *pool);

/**
 * Run task(context, 0) .. task(context, count - 1) and return when all are done. One caller at a
 * time; tasks must not call it. Allocates nothing.
 */
void dvsm_pool_run(struct dvsm_pool *pool, size_t count, dvsm_task_fn *task, void *context);

/* ---- work cut into tasks ---- */

/** Tiles of `size` that cover `count`. */
static inline size_t dvsm_tiles(size_t count, size_t size)
{
	return (count + size - 1) / size;
}

/** The part of `count` that tile `index` covers. */
static inline size_t dvsm_tile_length(size_t count, size_t size, size_t index)
{
	size_t left = count - index * size;

	return left < size ? left : size;
}

#endif
