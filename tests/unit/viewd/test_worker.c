/* The worker: jobs in turn on another thread, answers on this one. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>

#include "viewd/worker.h"

#define JOBS    8
#define WAIT_MS 20000

struct counted_job {
	struct dio_job job;
	int number;
	pthread_t ran_on, done_on;
	bool ran;
};

static int order[2 * JOBS], done_count;
static atomic_bool gate;

static enum dio_status run(struct dio_job *base, struct dio_error *error)
{
	struct counted_job *job = (struct counted_job *)base;

	while (!atomic_load(&gate))
		;
	job->ran = true;
	job->ran_on = pthread_self();
	if (job->number % 2)
		return dio_fail(error, DIO_REFUSED, "job %d is odd", job->number);
	return DIO_OK;
}

static void done(struct dio_job *base)
{
	struct counted_job *job = (struct counted_job *)base;

	job->done_on = pthread_self();
	order[done_count++] = job->number;
}

static void post_all(struct dio_worker *worker, struct counted_job *jobs)
{
	for (int i = 0; i < JOBS; i++) {
		jobs[i] = (struct counted_job){.job = {.run = run, .done = done}, .number = i};
		dio_worker_post(worker, &jobs[i].job);
	}
}

static void jobs_run_in_turn_and_are_answered_here(void **state)
{
	struct counted_job jobs[JOBS];
	struct dio_worker *worker;
	struct dio_error error;

	(void)state;
	done_count = 0;
	atomic_store(&gate, true);
	assert_int_equal(dio_worker_create("test", &worker, &error), DIO_OK);
	post_all(worker, jobs);
	while (dio_worker_get_pending(worker) > 0) {
		struct pollfd fd = {.fd = dio_worker_get_fd(worker), .events = POLLIN};

		assert_int_equal(poll(&fd, 1, WAIT_MS), 1);
		dio_worker_dispatch(worker);
	}
	assert_int_equal(done_count, JOBS);
	for (int i = 0; i < JOBS; i++) {
		assert_int_equal(order[i], i);
		assert_false(pthread_equal(jobs[i].ran_on, pthread_self()));
		assert_true(pthread_equal(jobs[i].done_on, pthread_self()));
		assert_int_equal(jobs[i].job.status, i % 2 ? DIO_REFUSED : DIO_OK);
	}
	assert_string_equal(jobs[3].job.error.text, "job 3 is odd");
	dio_worker_destroy(worker);
}

static void every_job_is_answered_when_the_worker_ends(void **state)
{
	struct counted_job jobs[JOBS];
	struct dio_worker *worker;
	struct dio_error error;
	int ran = 0;

	(void)state;
	done_count = 0;
	atomic_store(&gate, false);
	assert_int_equal(dio_worker_create("test", &worker, &error), DIO_OK);
	post_all(worker, jobs);
	atomic_store(&gate, true);
	dio_worker_destroy(worker);
	assert_int_equal(done_count, JOBS);
	for (int i = 0; i < JOBS; i++) {
		ran += jobs[i].ran;
		if (!jobs[i].ran)
			assert_int_equal(jobs[i].job.status, DIO_END);
	}
	assert_true(ran <= JOBS);
	dio_worker_destroy(NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(jobs_run_in_turn_and_are_answered_here),
		cmocka_unit_test(every_job_is_answered_when_the_worker_ends),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
