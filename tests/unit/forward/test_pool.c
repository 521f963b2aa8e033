/* The thread pool: every task once, no two tasks in one scratch area, quick and clean ends. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "threads/pool.h"

#define MAX_TASKS 1000

struct tally {
	_Atomic uint32_t runs[MAX_TASKS];
	_Atomic uint32_t busy[DVSM_MAX_THREADS];
	_Atomic uint32_t clashes;
	uint32_t plain[MAX_TASKS]; /* written without atomics: the pool must order it */
	uint32_t threads;
};

static void count_task(void *context, size_t index, uint32_t worker)
{
	struct tally *tally = context;

	if (worker >= tally->threads || atomic_fetch_add(&tally->busy[worker], 1) != 0)
		atomic_fetch_add(&tally->clashes, 1);
	atomic_fetch_add(&tally->runs[index], 1);
	tally->plain[index]++;
	atomic_fetch_sub(&tally->busy[worker], 1);
}

static void every_task_runs_once_for_any_thread_and_task_count(void **state)
{
	static const uint32_t threads[] = {1, 2, 3, 5, 16};
	static const size_t tasks[] = {0, 1, 2, 3, 7, 64, MAX_TASKS};
	static struct tally tally;

	(void)state;
	for (size_t t = 0; t < sizeof(threads) / sizeof(threads[0]); t++) {
		struct dvsm_pool *pool;

		assert_int_equal(dvsm_pool_create(threads[t], &pool, NULL), DVSM_OK);
		assert_int_equal(dvsm_pool_get_threads(pool), threads[t]);
		for (size_t n = 0; n < sizeof(tasks) / sizeof(tasks[0]); n++) {
			memset(&tally, 0, sizeof(tally));
			tally.threads = threads[t];
			dvsm_pool_run(pool, tasks[n], count_task, &tally);
			for (size_t i = 0; i < MAX_TASKS; i++) {
				assert_int_equal(tally.runs[i], i < tasks[n]);
				assert_int_equal(tally.plain[i], i < tasks[n]);
			}
			assert_int_equal(tally.clashes, 0);
		}
		dvsm_pool_destroy(pool);
	}
}

static void add_task(void *context, size_t index, uint32_t worker)
{
	uint64_t *sums = context;

	(void)worker;
	sums[index] += index + 1;
}

static void one_job_sees_what_the_job_before_it_wrote(void **state)
{
	enum { JOBS = 20000, TASKS = 5 };
	uint64_t sums[TASKS] = {0};
	struct dvsm_pool *pool;

	(void)state;
	assert_int_equal(dvsm_pool_create(3, &pool, NULL), DVSM_OK);
	for (int i = 0; i < JOBS; i++)
		dvsm_pool_run(pool, TASKS, add_task, sums);
	dvsm_pool_destroy(pool);
	for (uint64_t i = 0; i < TASKS; i++)
		assert_int_equal(sums[i], JOBS * (i + 1));
}

static void slow_task(void *context, size_t index, uint32_t worker)
{
	struct timespec pause = {.tv_nsec = 3 * 1000 * 1000};
	uint32_t *done = context;

	(void)worker;
	nanosleep(&pause, NULL);
	done[index] = 1;
}

static void run_returns_only_when_the_slowest_task_is_done(void **state)
{
	struct dvsm_pool *pool;

	(void)state;
	assert_int_equal(dvsm_pool_create(4, &pool, NULL), DVSM_OK);
	/* Seven over four: at the end some thread is far behind the caller. */
	for (int i = 0; i < 20; i++) {
		uint32_t done[7] = {0};

		dvsm_pool_run(pool, 7, slow_task, done);
		for (size_t j = 0; j < 7; j++)
			assert_int_equal(done[j], 1);
	}
	dvsm_pool_destroy(pool);
}

static void pools_come_and_go_with_and_without_work(void **state)
{
	uint64_t sums[4] = {0};

	(void)state;
	for (int i = 0; i < 200; i++) {
		struct dvsm_pool *pool;

		assert_int_equal(dvsm_pool_create(4, &pool, NULL), DVSM_OK);
		if (i % 2)
			dvsm_pool_run(pool, 4, add_task, sums);
		dvsm_pool_destroy(pool);
	}
	dvsm_pool_destroy(NULL);
	assert_int_equal(sums[0], 100);
}

static void impossible_thread_counts_are_refused_in_words(void **state)
{
	struct dvsm_pool *pool = NULL;
	struct dvsm_error error = {""};

	(void)state;
	assert_int_equal(dvsm_pool_create(0, &pool, &error), DVSM_BAD_ARG);
	assert_int_equal(dvsm_pool_create(257, &pool, &error), DVSM_BAD_ARG);
	assert_non_null(strstr(error.text, "257"));
	assert_null(pool);
	assert_in_range(dvsm_pool_processors(), 1, DVSM_MAX_THREADS);
}

static void idle_threads_sleep(void **state)
{
	struct timespec pause = {.tv_nsec = 200 * 1000 * 1000}, before, after;
	uint64_t sums[4] = {0};
	struct dvsm_pool *pool;

	(void)state;
	assert_int_equal(dvsm_pool_create(4, &pool, NULL), DVSM_OK);
	dvsm_pool_run(pool, 4, add_task, sums);
	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &before);
	nanosleep(&pause, NULL);
	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &after);
	dvsm_pool_destroy(pool);

	double used_ms = (double)(after.tv_sec - before.tv_sec) * 1e3 +
			 (double)(after.tv_nsec - before.tv_nsec) / 1e6;

	/* Three threads that polled on would use up to 600 ms; emulation and sanitizers some. */
	assert_true(used_ms < 50);
}

/* Where each worker may run, once all of them have met. */
struct meeting {
	_Atomic uint32_t arrived;
	uint32_t threads;
	cpu_set_t allowed[DVSM_MAX_THREADS];
};

static void meet_task(void *context, size_t index, uint32_t worker)
{
	struct meeting *meeting = context;
	struct timespec start, now;

	(void)index;
	clock_gettime(CLOCK_MONOTONIC, &start);
	sched_getaffinity(0, sizeof(meeting->allowed[worker]), &meeting->allowed[worker]);
	atomic_fetch_add(&meeting->arrived, 1);
	do {
		sched_yield();
		clock_gettime(CLOCK_MONOTONIC, &now);
	} while (atomic_load(&meeting->arrived) < meeting->threads &&
		 now.tv_sec - start.tv_sec < 60);
}

static void hold_meeting(uint32_t threads, struct meeting *meeting)
{
	struct dvsm_pool *pool;

	memset(meeting, 0, sizeof(*meeting));
	meeting->threads = threads;
	assert_int_equal(dvsm_pool_create(threads, &pool, NULL), DVSM_OK);
	dvsm_pool_run(pool, threads, meet_task, meeting);
	dvsm_pool_destroy(pool);
	assert_int_equal(meeting->arrived, threads);
}

static void a_pool_of_all_processors_has_each_worker_on_its_own(void **state)
{
	static struct meeting meeting;
	uint32_t processors = dvsm_pool_processors();
	cpu_set_t before, used;

	(void)state;
	if (processors < 2 || processors == DVSM_MAX_THREADS)
		skip();
	CPU_ZERO(&used);
	assert_int_equal(sched_getaffinity(0, sizeof(before), &before), 0);
	hold_meeting(processors, &meeting);
	assert_true(CPU_EQUAL(&meeting.allowed[0], &before)); /* the caller's own */
	for (uint32_t i = 1; i < processors; i++) {
		assert_int_equal(CPU_COUNT(&meeting.allowed[i]), 1);
		CPU_OR(&used, &used, &meeting.allowed[i]);
	}
	assert_int_equal(CPU_COUNT(&used), (int)processors - 1);
}

static void a_pool_of_more_or_fewer_threads_leaves_them_to_the_system(void **state)
{
	static struct meeting meeting;
	uint32_t processors = dvsm_pool_processors();

	(void)state;
	if (processors == DVSM_MAX_THREADS)
		skip();
	hold_meeting(processors + 1, &meeting);
	for (uint32_t i = 0; i <= processors; i++)
		assert_int_equal(CPU_COUNT(&meeting.allowed[i]), (int)processors);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_task_runs_once_for_any_thread_and_task_count),
		cmocka_unit_test(one_job_sees_what_the_job_before_it_wrote),
		cmocka_unit_test(run_returns_only_when_the_slowest_task_is_done),
		cmocka_unit_test(pools_come_and_go_with_and_without_work),
		cmocka_unit_test(impossible_thread_counts_are_refused_in_words),
		cmocka_unit_test(idle_threads_sleep),
		cmocka_unit_test(a_pool_of_all_processors_has_each_worker_on_its_own),
		cmocka_unit_test(a_pool_of_more_or_fewer_threads_leaves_them_to_the_system),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
