#include "viewd/worker.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

/* Jobs in the order of their arrival. */
struct queue {
	struct dio_job *first, **last;
};

struct dio_worker {
	pthread_t thread;
	pthread_mutex_t lock;
	pthread_cond_t wake;
	struct queue waiting, finished; /* under the lock */
	bool stop;                      /* under the lock */
	uint32_t pending;               /* the loop's */
	int event_fd;
};

static void queue_init(struct queue *queue)
{
	queue->first = NULL;
	queue->last = &queue->first;
}

static void queue_push(struct queue *queue, struct dio_job *job)
{
	job->next = NULL;
	*queue->last = job;
	queue->last = &job->next;
}

static struct dio_job *queue_pop(struct queue *queue)
{
	struct dio_job *job = queue->first;

	if (!job)
		return NULL;
	queue->first = job->next;
	if (!queue->first)
		queue->last = &queue->first;
	return job;
}

static void *work(void *context)
{
	struct dio_worker *worker = context;
	struct dio_job *job;

	pthread_mutex_lock(&worker->lock);
	while (!worker->stop) {
		job = queue_pop(&worker->waiting);
		if (!job) {
			pthread_cond_wait(&worker->wake, &worker->lock);
			continue;
		}
		pthread_mutex_unlock(&worker->lock);
		job->status = job->run(job, &job->error);
		pthread_mutex_lock(&worker->lock);
		queue_push(&worker->finished, job);
		eventfd_write(worker->event_fd, 1);
	}
	pthread_mutex_unlock(&worker->lock);
	return NULL;
}

enum dio_status dio_worker_create(const char *name, struct dio_worker **worker,
				  struct dio_error *error)
{
	struct dio_worker *made = calloc(1, sizeof *made);
	int result;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "thread %s: no memory", name);
	made->event_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (made->event_fd < 0) {
		free(made);
		return dio_fail(error, DIO_IO, "thread %s: no descriptor left", name);
	}
	pthread_mutex_init(&made->lock, NULL);
	pthread_cond_init(&made->wake, NULL);
	queue_init(&made->waiting);
	queue_init(&made->finished);
	result = pthread_create(&made->thread, NULL, work, made);
	if (result != 0) {
		close(made->event_fd);
		free(made);
		return dio_fail(error, dio_status_from_errno(result), "thread %s: %s", name,
				strerror(result));
	}
	pthread_setname_np(made->thread, name);
	*worker = made;
	return DIO_OK;
}

void dio_worker_post(struct dio_worker *worker, struct dio_job *job)
{
	job->status = DIO_OK;
	job->error.text[0] = '\0';
	worker->pending++;
	pthread_mutex_lock(&worker->lock);
	queue_push(&worker->waiting, job);
	pthread_cond_signal(&worker->wake);
	pthread_mutex_unlock(&worker->lock);
}

int dio_worker_get_fd(const struct dio_worker *worker)
{
	return worker->event_fd;
}

uint32_t dio_worker_get_pending(const struct dio_worker *worker)
{
	return worker->pending;
}

void dio_worker_dispatch(struct dio_worker *worker)
{
	struct dio_job *job, *next;
	eventfd_t count;

	eventfd_read(worker->event_fd, &count);
	pthread_mutex_lock(&worker->lock);
	job = worker->finished.first;
	queue_init(&worker->finished);
	pthread_mutex_unlock(&worker->lock);
	/* done() may post the next job. */
	for (; job; job = next) {
		next = job->next;
		worker->pending--;
		job->done(job);
	}
}

void dio_worker_destroy(struct dio_worker *worker)
{
	struct dio_job *job;

	if (!worker)
		return;
	pthread_mutex_lock(&worker->lock);
	worker->stop = true;
	pthread_cond_signal(&worker->wake);
	pthread_mutex_unlock(&worker->lock);
	pthread_join(worker->thread, NULL);
	dio_worker_dispatch(worker);
	while ((job = queue_pop(&worker->waiting))) {
		job->status = DIO_END;
		job->done(job);
	}
	pthread_cond_destroy(&worker->wake);
	pthread_mutex_destroy(&worker->lock);
	close(worker->event_fd);
	free(worker);
}
