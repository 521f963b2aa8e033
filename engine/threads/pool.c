#include "threads/pool.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "base/memory.h"

/*
 * Polls before a thread sleeps: some ten microseconds, the gap between two jobs of a layer. To wake
 * a processor that sleeps takes as long as a task, more where it is a virtual one; so a worker
 * whose part of a job is done polls on until the others' are, and the caller for about a
 * millisecond, but both let whoever else wants the processor have it now and then.
 */
#define SPINS        1000
#define CALLER_SPINS 20000
#define YIELD_EVERY  64

/* Bytes of a worker's stack: tasks have strips of rows there, up to 64 KiB, and what they make. */
#define STACK_TOUCHED 131072

struct worker {
	struct dvsm_pool *pool;
	pthread_t thread;
	uint32_t index;
	_Alignas(64) _Atomic size_t next; /* task to claim of its own part of the job */
	size_t end;
};

struct dvsm_pool {
	uint32_t threads;
	uint32_t started; /* workers to join; worker 0 is the caller and has no thread */

	pthread_mutex_t mutex;
	pthread_cond_t wake; /* to workers: a job opened, or stop */
	pthread_cond_t idle; /* to the caller: the last worker left the job */

	/* The job. A worker enters it under the mutex and only while it is open, so the caller need
	 * not wait for workers that never woke up.
	 */
	dvsm_task_fn *task;
	void *context;
	bool stop;
	_Atomic bool open; /* changed under the mutex; workers that wait poll it */
	uint32_t sleepers;

	_Atomic uint64_t generation; /* of the job; workers poll it */
	_Atomic uint32_t inside;     /* workers in the job; the caller polls it */

	struct worker workers[];
};

/* The processors that this thread may run on, `bytes` of them; NULL when they cannot be told.
 * Release with CPU_FREE(). */
static cpu_set_t *allowed_processors(size_t *bytes)
{
	/* The kernel refuses a mask smaller than its own; grow until it fits. */
	for (int cpus = 1024; cpus <= 1 << 20; cpus *= 4) {
		cpu_set_t *set = CPU_ALLOC(cpus);

		*bytes = CPU_ALLOC_SIZE(cpus);
		if (!set)
			break;
		if (sched_getaffinity(0, *bytes, set) == 0)
			return set;
		CPU_FREE(set);
	}
	return NULL;
}

uint32_t dvsm_pool_processors(void)
{
	size_t bytes;
	cpu_set_t *set = allowed_processors(&bytes);
	uint32_t found = set ? (uint32_t)CPU_COUNT_S(bytes, set) : 1;

	if (set)
		CPU_FREE(set);
	if (found < 1)
		return 1;
	return found < DVSM_MAX_THREADS ? found : DVSM_MAX_THREADS;
}

static inline void relax(void)
{
#if defined(__x86_64__)
	__builtin_ia32_pause();
#elif defined(__aarch64__)
	__asm__ volatile("yield");
#endif
}

/* Cut the job's tasks into a part for each thread. */
static void share_out(struct dvsm_pool *pool, size_t count)
{
	for (uint32_t i = 0; i < pool->threads; i++) {
		size_t share = count / pool->threads, rest = count % pool->threads;
		size_t first = i * share + (i < rest ? i : rest);

		atomic_store_explicit(&pool->workers[i].next, first, memory_order_relaxed);
		pool->workers[i].end = first + share + (i < rest);
	}
}

/* A thread's own part, then what is left of the others'. */
static void take_tasks(struct dvsm_pool *pool, dvsm_task_fn *task, void *context, uint32_t worker)
{
	for (uint32_t i = 0; i < pool->threads; i++) {
		struct worker *from = &pool->workers[(worker + i) % pool->threads];

		for (;;) {
			size_t index =
				atomic_fetch_add_explicit(&from->next, 1, memory_order_relaxed);

			if (index >= from->end)
				break;
			task(context, index, worker);
		}
	}
}

/* Wait for a generation other than `seen`, or for the end; called and left with the mutex held. */
static void wait_for_job(struct dvsm_pool *pool, uint64_t seen)
{
	pthread_mutex_unlock(&pool->mutex);
	for (uint32_t polls = 1, idle = 0; idle < SPINS; polls++) {
		if (atomic_load_explicit(&pool->generation, memory_order_relaxed) != seen)
			break;
		if (!atomic_load_explicit(&pool->open, memory_order_relaxed))
			idle++;
		else if (polls % YIELD_EVERY == 0)
			sched_yield();
		relax();
	}
	pthread_mutex_lock(&pool->mutex);
	while (atomic_load_explicit(&pool->generation, memory_order_relaxed) == seen) {
		pool->sleepers++;
		pthread_cond_wait(&pool->wake, &pool->mutex);
		pool->sleepers--;
	}
}

/* Have the pages of the stack that tasks come to now, not in the frame in which one first does. */
static void touch_stack(void)
{
	volatile unsigned char room[STACK_TOUCHED];

	for (size_t i = 0; i < sizeof(room); i += 1024)
		room[i] = 0;
}

static void *worker_main(void *argument)
{
	struct worker *worker = argument;
	struct dvsm_pool *pool = worker->pool;
	uint64_t seen = 0;

	touch_stack();
	pthread_mutex_lock(&pool->mutex);
	for (;;) {
		wait_for_job(pool, seen);
		seen = atomic_load_explicit(&pool->generation, memory_order_relaxed);
		if (pool->stop)
			break;
		if (!atomic_load_explicit(&pool->open, memory_order_relaxed))
			continue;
		atomic_fetch_add_explicit(&pool->inside, 1, memory_order_relaxed);

		dvsm_task_fn *task = pool->task;
		void *context = pool->context;

		pthread_mutex_unlock(&pool->mutex);
		take_tasks(pool, task, context, worker->index);
		pthread_mutex_lock(&pool->mutex);
		if (atomic_fetch_sub_explicit(&pool->inside, 1, memory_order_release) == 1)
			pthread_cond_signal(&pool->idle);
	}
	pthread_mutex_unlock(&pool->mutex);
	return NULL;
}

static void next_generation(struct dvsm_pool *pool)
{
	atomic_fetch_add_explicit(&pool->generation, 1, memory_order_relaxed);
	if (pool->sleepers > 0)
		pthread_cond_broadcast(&pool->wake);
}

void dvsm_pool_run(struct dvsm_pool *pool, size_t count, dvsm_task_fn *task, void *context)
{
	if (pool->threads == 1 || count <= 1) {
		for (size_t i = 0; i < count; i++)
			task(context, i, 0);
		return;
	}

	pthread_mutex_lock(&pool->mutex);
	pool->task = task;
	pool->context = context;
	atomic_store_explicit(&pool->open, true, memory_order_relaxed);
	share_out(pool, count);
	next_generation(pool);
	pthread_mutex_unlock(&pool->mutex);

	take_tasks(pool, task, context, 0);

	pthread_mutex_lock(&pool->mutex);
	atomic_store_explicit(&pool->open, false, memory_order_relaxed);
	pthread_mutex_unlock(&pool->mutex);
	for (int i = 1; i <= CALLER_SPINS; i++) {
		if (atomic_load_explicit(&pool->inside, memory_order_acquire) == 0)
			return;
		if (i % YIELD_EVERY == 0)
			sched_yield();
		relax();
	}
	pthread_mutex_lock(&pool->mutex);
	while (atomic_load_explicit(&pool->inside, memory_order_acquire) > 0)
		pthread_cond_wait(&pool->idle, &pool->mutex);
	pthread_mutex_unlock(&pool->mutex);
}

static bool start_workers(struct dvsm_pool *pool)
{
	for (uint32_t i = 1; i < pool->threads; i++) {
		struct worker *worker = &pool->workers[i];
		char name[16];

		worker->pool = pool;
		worker->index = i;
		if (pthread_create(&worker->thread, NULL, worker_main, worker))
			return false;
		pool->started++;
		snprintf(name, sizeof(name), "dvsm-%u", i);
		pthread_setname_np(worker->thread, name);
	}
	return true;
}

/* Each worker to a processor of its own; `mine` stays free for the caller. */
static void pin_to(struct dvsm_pool *pool, const cpu_set_t *allowed, size_t bytes, int mine)
{
	cpu_set_t *one = CPU_ALLOC(8 * bytes);
	uint32_t worker = 1;

	for (int cpu = 0; one && worker < pool->threads && cpu < (int)(8 * bytes); cpu++) {
		if (!CPU_ISSET_S(cpu, bytes, allowed) || cpu == mine)
			continue;
		CPU_ZERO_S(bytes, one);
		CPU_SET_S(cpu, bytes, one);
		/* It is for speed alone: a worker that cannot be pinned works all the same. */
		pthread_setaffinity_np(pool->workers[worker].thread, bytes, one);
		worker++;
	}
	if (one)
		CPU_FREE(one);
}

/*
 * Only a pool that has all processors is pinned. With fewer threads there is a choice, and the
 * scheduler, which sees what else runs, makes it better.
 */
static void pin_workers(struct dvsm_pool *pool)
{
	size_t bytes;
	cpu_set_t *allowed = allowed_processors(&bytes);

	if (!allowed)
		return;
	if ((uint32_t)CPU_COUNT_S(bytes, allowed) == pool->threads)
		pin_to(pool, allowed, bytes, sched_getcpu());
	CPU_FREE(allowed);
}

enum dvsm_status dvsm_pool_create(uint32_t threads, struct dvsm_pool **pool,
				  struct dvsm_error *error)
{
	if (threads < 1 || threads > DVSM_MAX_THREADS)
		return dvsm_fail(error, DVSM_BAD_ARG, "%u threads: 1 to %u are possible", threads,
				 DVSM_MAX_THREADS);

	const size_t bytes = sizeof(struct dvsm_pool) + threads * sizeof(struct worker);
	struct dvsm_pool *made = dvsm_aligned_alloc(bytes);

	if (!made)
		return dvsm_fail(error, DVSM_NO_MEM, "no memory for a pool of %u threads", threads);
	memset(made, 0, bytes);
	made->threads = threads;
	pthread_mutex_init(&made->mutex, NULL);
	pthread_cond_init(&made->wake, NULL);
	pthread_cond_init(&made->idle, NULL);
	if (!start_workers(made)) {
		uint32_t started = made->started;

		dvsm_pool_destroy(made);
		return dvsm_fail(error, DVSM_NO_MEM,
				 "thread %u of %u could not be started: ask for fewer threads",
				 started + 2, threads);
	}
	pin_workers(made);
	*pool = made;
	return DVSM_OK;
}

void dvsm_pool_destroy(struct dvsm_pool *pool)
{
	if (!pool)
		return;
	pthread_mutex_lock(&pool->mutex);
	pool->stop = true;
	next_generation(pool);
	pthread_mutex_unlock(&pool->mutex);
	for (uint32_t i = 1; i <= pool->started; i++)
		pthread_join(pool->workers[i].thread, NULL);
	pthread_cond_destroy(&pool->idle);
	pthread_cond_destroy(&pool->wake);
	pthread_mutex_destroy(&pool->mutex);
	free(pool);
}

uint32_t dvsm_pool_get_threads(const struct dvsm_pool *pool)
{
	return pool->threads;
}
