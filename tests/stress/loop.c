/* The render loop for 10,000 frames: no allocation, no drift in time, memory or bits. */
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "stress/world.h"
#include "support/allocations.h"
#include "support/random_model.h"

#define ORBIT       100u /* frames of a round; every round shows the same */
#define STACK_PAGES 32u  /* what a worker may come to late */

/* Frames at either end whose median time is compared. */
static uint32_t span(const struct stress_job *job)
{
	return job->quick ? 200 : 1000;
}

static uint32_t rounds(const struct stress_job *job)
{
	return job->quick ? 10 : 100;
}

/* What is kept of the loop, all of it allocated before. */
struct record {
	uint32_t frames;
	double *seconds;        /* [frames] of processor time, all threads */
	uint64_t hashes[ORBIT]; /* of the first round */
	size_t differing;       /* frames of later rounds with other bits */
	size_t allocations;
	long resident_before, resident_most; /* pages, from the end of the first round on */
	size_t growths;                      /* later rounds that ended with more than ever */
	enum dvsm_status status;
	struct dvsm_error error;
};

/* FNV-1a over the bits of a picture. */
static uint64_t hash_of(const float *picture, size_t numbers)
{
	uint64_t hash = 0xcbf29ce484222325u;

	for (size_t i = 0; i < numbers; i++) {
		uint32_t bits;

		memcpy(&bits, &picture[i], sizeof(bits));
		hash = (hash ^ bits) * 0x100000001b3u;
	}
	return hash;
}

static double processor_seconds(void)
{
	struct timespec now;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
	return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

/* Pages of this process's own in memory: those of program files come and go by the dozen. -1 where
 * the system does not say. Must not allocate. */
static long resident_pages(void)
{
	char text[128];
	long total, resident, shared;
	int file = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
	ssize_t length = file >= 0 ? read(file, text, sizeof(text) - 1) : -1;

	if (file >= 0)
		close(file);
	if (length <= 0)
		return -1;
	text[length] = 0;
	return sscanf(text, "%ld %ld %ld", &total, &resident, &shared) == 3 ? resident - shared
									    : -1;
}

static void count_growth(struct record *record)
{
	const long resident = resident_pages();

	if (resident <= record->resident_most)
		return;
	record->resident_most = resident;
	record->growths++;
}

static void run_loop(struct dvsm_engine *engine, const struct dvsm_scene *scene,
		     const struct stress_recipe *recipe, float *picture, struct record *record)
{
	const size_t numbers = (size_t)recipe->width * recipe->height * 3;
	size_t allocations = 0;

	for (uint32_t i = 0; i < record->frames; i++) {
		struct dvsm_camera camera =
			support_ring_camera(recipe->width, recipe->height, i % ORBIT, ORBIT);
		double begin = processor_seconds();

		record->status =
			dvsm_render(engine, scene, &camera, 0, picture, NULL, &record->error);
		record->seconds[i] = processor_seconds() - begin;
		if (record->status != DVSM_OK)
			return;

		uint64_t hash = hash_of(picture, numbers);

		if (i < ORBIT)
			record->hashes[i] = hash;
		else
			record->differing += hash != record->hashes[i % ORBIT];
		/* The first round may still fault pages in that were reserved before. */
		if (i + 1 == ORBIT) {
			allocations = allocations_made();
			record->resident_before = record->resident_most = resident_pages();
		} else if ((i + 1) % ORBIT == 0) {
			count_growth(record);
		}
	}
	record->allocations = allocations_made() - allocations;
}

static int compare(const void *a, const void *b)
{
	const double *x = a, *y = b;

	return (*x > *y) - (*x < *y);
}

static double median(double *values, size_t count)
{
	qsort(values, count, sizeof(values[0]), compare);
	return values[count / 2];
}

static void state(const struct stress_job *job, struct record *record, const char *precision)
{
	const uint32_t part = span(job);
	char name[32];
	struct stress_figure figure = {
		.group = "loop",
		.name = name,
		.precision = precision,
		.judgement = STRESS_AT_MOST,
	};

	snprintf(name, sizeof(name), "%u frames", record->frames);
	if (record->status != DVSM_OK) {
		stress_report_fault(job->report, &figure, record->error.text);
		return;
	}

	double first = median(record->seconds, part);
	double last = median(record->seconds + record->frames - part, part);

	figure.what = "allocations";
	figure.value = (double)record->allocations;
	stress_report_add(job->report, &figure);
	figure.what = "frames with other bits";
	figure.value = (double)record->differing;
	stress_report_add(job->report, &figure);
	/* What leaks grows round after round. The pages of a stack come once or twice: on a busy
	 * processor a worker may not get its first task of a kind for many rounds. */
	figure.what = "rounds that memory grew in";
	figure.value = (double)record->growths;
	figure.limit = 2 * job->threads;
	stress_report_add(job->report, &figure);
	/* A worker's stack is 8 pages deep, with a sanitizer three times that and its shadow. */
	figure.what = "pages of memory grown";
	figure.value = (double)(record->resident_most - record->resident_before);
	figure.limit = STACK_PAGES * job->threads;
	stress_report_add(job->report, &figure);
	/* Wide, because other programs share the caches and the cores' clock; a loop that slows
	 * down passes any limit after enough frames, and a short one tells less. */
	figure.what = "time, last over first frames";
	figure.value = last / first;
	figure.limit = record->frames < 5000 ? 3 : 1.5;
	stress_report_add(job->report, &figure);
	figure.what = "ms a frame, all threads";
	figure.judgement = STRESS_STATED;
	figure.value = 1e3 * last;
	stress_report_add(job->report, &figure);
}

static void check(const struct stress_job *job, enum dvsm_precision precision)
{
	struct stress_recipe recipe = stress_recipe_base;

	recipe.name = "loop";
	recipe.seed = job->seed;
	recipe.config.layers = 2;
	recipe.views = 2;
	recipe.width = recipe.height = 32;

	struct stress_world *world = stress_world_make(&recipe);
	const struct dvsm_engine_options options = {.threads = job->threads,
						    .precision = precision};
	struct record record = {.frames = ORBIT * rounds(job)};
	float *picture = support_reference_allocate(world->numbers, sizeof(*picture));
	struct dvsm_engine *engine = NULL;
	struct dvsm_scene *scene = NULL;

	record.seconds = support_reference_allocate(record.frames, sizeof(record.seconds[0]));
	/* Have its pages before the loop counts pages. */
	for (uint32_t i = 0; i < record.frames; i++)
		record.seconds[i] = INFINITY;
	record.status = dvsm_engine_create(world->model, &options, &engine, &record.error);
	if (record.status == DVSM_OK)
		record.status = dvsm_reconstruct(engine, world->views, recipe.views, 0, NULL, NULL,
						 &scene, NULL, &record.error);
	if (record.status == DVSM_OK)
		record.status =
			dvsm_render_reserve(engine, scene, &world->target, 0, &record.error);
	if (record.status == DVSM_OK)
		run_loop(engine, scene, &recipe, picture, &record);
	state(job, &record, dvsm_precision_name(precision));
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
	free(record.seconds);
	free(picture);
	stress_world_free(world);
}

void stress_loop(const struct stress_job *job)
{
	for (size_t p = 0; p < job->precision_count; p++)
		check(job, job->precisions[p]);
}
