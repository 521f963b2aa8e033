#include "bench/measure.h"

#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/count.h"
#include "core/session.h"
#include "dio/pose.h"

#define RUNS_AT_LEAST 3u
#define LONG_NS       10000000000u /* runs that took this long together are enough */

/* The highest resident size since the last call with `begin`; 0 when the system does not say. */
static size_t read_peak_bytes(void)
{
	FILE *stream = fopen("/proc/self/status", "re");
	unsigned long kib = 0;
	char line[256];

	while (stream && fgets(line, sizeof line, stream)) {
		if (sscanf(line, "VmHWM: %lu", &kib) == 1)
			break;
	}
	if (stream)
		fclose(stream);
	return (size_t)kib * 1024;
}

static void forget_peak(void)
{
	int file = open("/proc/self/clear_refs", O_WRONLY | O_CLOEXEC);

	if (file < 0)
		return;
	/* Where this is refused the peak is that of all measurements so far. */
	(void)!write(file, "5", 1);
	close(file);
}

static int compare(const void *a, const void *b)
{
	const uint64_t *x = a, *y = b;

	return (*x > *y) - (*x < *y);
}

/* Linear between the runs beside it. */
static double quantile_ms(const uint64_t *sorted_ns, uint32_t count, double share)
{
	const double at = share * (count - 1);
	const uint32_t below = (uint32_t)at, above = below + 1 < count ? below + 1 : below;

	return 1e-6 * ((double)sorted_ns[below] +
		       (at - below) * ((double)sorted_ns[above] - (double)sorted_ns[below]));
}

/* The first run warmed up and does not count. */
static struct dio_times sum_up(uint64_t *times_ns, uint32_t count, double operations)
{
	qsort(times_ns, count, sizeof *times_ns, compare);
	return (struct dio_times){
		.runs = count,
		.best_ms = quantile_ms(times_ns, count, 0),
		.low_ms = quantile_ms(times_ns, count, 0.25),
		.median_ms = quantile_ms(times_ns, count, 0.5),
		.high_ms = quantile_ms(times_ns, count, 0.75),
		.worst_ms = quantile_ms(times_ns, count, 1),
		.operations = operations,
	};
}

double dio_times_spread(const struct dio_times *times)
{
	return 0.5 * (times->high_ms - times->low_ms) / times->median_ms;
}

/* One measurement under way. */
struct bench {
	const struct dio_work *work;
	const struct dio_measure *wish;
	struct dvsm_view *views; /* those used, [wish->views] */
	struct dvsm_engine *engine;
	struct dvsm_scene *scene;
	struct dio_picture picture;
	float *rgb; /* of the largest target */
};

static bool enough(uint64_t spent_ns, uint32_t runs, const struct dio_measure *wish)
{
	return runs >= wish->runs || (runs >= RUNS_AT_LEAST && spent_ns > LONG_NS);
}

static struct dvsm_camera target_camera(const struct dio_work *work, uint32_t target)
{
	const struct dio_view *view = &work->views.target[target % work->views.target_count];

	return dio_view_engine_camera(&view->camera, &view->pose);
}

static enum dvsm_status time_reconstruct(struct bench *bench, struct dio_measured *made,
					 struct dvsm_error *fault)
{
	const struct dio_measure *wish = bench->wish;
	double *tokens = calloc(wish->views, sizeof *tokens), operations;
	uint64_t times_ns[DIO_RUNS_MAX], spent_ns = 0;
	enum dvsm_status status = tokens ? DVSM_OK : DVSM_NO_MEM;
	struct dvsm_stats stats = {0};
	uint32_t runs = 0;

	for (bool warm = false; status == DVSM_OK && !enough(spent_ns, runs, wish); warm = true) {
		dvsm_scene_destroy(bench->scene);
		bench->scene = NULL;
		status = dvsm_reconstruct(bench->engine, bench->views, wish->views, wish->patch_px,
					  NULL, NULL, &bench->scene, &stats, fault);
		if (warm) {
			times_ns[runs++] = stats.time_ns;
			spent_ns += stats.time_ns;
		}
	}
	if (status == DVSM_OK) {
		for (uint32_t i = 0; i < wish->views; i++)
			tokens[i] = dio_count_tokens(&bench->views[i].camera, wish->patch_px);
		operations = dio_count_reconstruct(&bench->work->config, tokens, wish->views);
		made->reconstruct = sum_up(times_ns, runs, operations);
		made->memory = stats.memory;
	}
	free(tokens);
	return status;
}

/* The targets in turn. */
static enum dvsm_status time_render(struct bench *bench, struct dio_measured *made,
				    struct dvsm_error *fault)
{
	const struct dio_measure *wish = bench->wish;
	const struct dvsm_model_config *config = &bench->work->config;
	uint64_t times_ns[DIO_RUNS_MAX], spent_ns = 0;
	enum dvsm_status status = DVSM_OK;
	struct dvsm_stats stats = {0};
	double operations = 0;
	uint32_t runs = 0;

	for (bool warm = false; status == DVSM_OK && !enough(spent_ns, runs, wish); warm = true) {
		const struct dvsm_camera camera = target_camera(bench->work, runs);

		status = dvsm_render(bench->engine, bench->scene, &camera, wish->patch_px,
				     bench->rgb, &stats, fault);
		if (warm) {
			times_ns[runs++] = stats.time_ns;
			spent_ns += stats.time_ns;
			operations += dio_count_render(config, stats.tokens, (double)stats.keys);
		}
	}
	if (status == DVSM_OK) {
		made->render = sum_up(times_ns, runs, operations / runs);
		made->tokens = stats.tokens;
		if (stats.memory.workspace_bytes > made->memory.workspace_bytes)
			made->memory.workspace_bytes = stats.memory.workspace_bytes;
	}
	return status;
}

/* Sums over the numbers compared so far. */
struct sums {
	double square, largest;
	size_t count;
};

static void add_difference(struct sums *sums, double ours, double wanted)
{
	const double difference = fabs(ours - wanted);

	sums->square += difference * difference;
	sums->largest = difference > sums->largest ? difference : sums->largest;
	sums->count++;
}

static struct dio_difference conclude(const struct sums *sums)
{
	if (sums->count == 0)
		return (struct dio_difference){0};
	return (struct dio_difference){true, sqrt(sums->square / (double)sums->count),
				       sums->largest};
}

static enum dio_status compare_picture(struct bench *bench, const struct dio_view *view,
				       struct sums *sums, double *psnr_db, struct dio_error *error)
{
	const size_t numbers = (size_t)view->camera.width * view->camera.height * 3;
	enum dio_status status = DIO_OK;

	if (bench->picture.width != view->camera.width ||
	    bench->picture.height != view->camera.height) {
		dio_picture_deinit(&bench->picture);
		bench->picture = (struct dio_picture){0};
		status = dio_picture_init(&bench->picture, view->camera.width, view->camera.height);
	}
	if (status != DIO_OK)
		return dio_fail(error, status, "no memory for a picture");
	dio_picture_from_float(bench->rgb, &bench->picture);
	for (size_t n = 0; n < numbers; n++)
		add_difference(sums, bench->picture.rgb[n] / 255.0, view->picture.rgb[n] / 255.0);
	*psnr_db += dio_metrics_psnr(&bench->picture, &view->picture);
	return DIO_OK;
}

/* Every target once: against float64, and against its true picture. */
static enum dio_status compare_targets(struct bench *bench, struct dio_measured *made,
				       struct dio_error *error)
{
	const struct dio_work *work = bench->work;
	const double *reference = bench->wish->reference;
	struct sums from_reference = {0}, from_truth = {0};
	enum dio_status status = DIO_OK;
	struct dvsm_error fault = {0};
	double psnr_db = 0;

	if (!reference && work->pictures == 0)
		return DIO_OK;
	for (uint32_t i = 0; status == DIO_OK && i < work->views.target_count; i++) {
		const struct dio_view *view = &work->views.target[i];
		const struct dvsm_camera camera = target_camera(work, i);
		const size_t numbers = (size_t)camera.width * camera.height * 3;

		status = dio_status_from_engine(dvsm_render(bench->engine, bench->scene, &camera,
							    bench->wish->patch_px, bench->rgb, NULL,
							    &fault),
						&fault, error);
		if (status == DIO_OK && reference && i < bench->wish->reference_targets)
			for (size_t n = 0; n < numbers; n++)
				add_difference(&from_reference, (double)bench->rgb[n],
					       *reference++);
		if (status == DIO_OK && view->picture.rgb)
			status = compare_picture(bench, view, &from_truth, &psnr_db, error);
	}
	made->from_reference = conclude(&from_reference);
	made->from_truth = conclude(&from_truth);
	made->psnr_db = work->pictures ? psnr_db / work->pictures : NAN;
	return status;
}

static enum dio_status open_bench(struct bench *bench, struct dio_measured *made,
				  struct dio_error *error)
{
	const struct dio_measure *wish = bench->wish;
	const struct dvsm_engine_options options = {
		.threads = wish->threads, .cpu_mask = wish->cpu_mask, .precision = wish->precision};
	struct dvsm_error fault = {0};
	enum dvsm_status status;
	size_t most = 1;

	for (uint32_t i = 0; i < bench->work->views.target_count; i++) {
		const struct dio_camera_model *camera = &bench->work->views.target[i].camera;
		const size_t numbers = (size_t)camera->width * camera->height * 3;

		most = numbers > most ? numbers : most;
	}
	bench->views = calloc(wish->views, sizeof *bench->views);
	bench->rgb = malloc(most * sizeof *bench->rgb);
	if (!bench->views || !bench->rgb)
		return dio_fail(error, DIO_NO_MEM, "no memory for %u views", wish->views);
	for (uint32_t i = 0; i < wish->views; i++)
		bench->views[i] = bench->work->context[dio_work_pick(bench->work, wish->views, i)];
	status = dvsm_engine_create(bench->work->model, &options, &bench->engine, &fault);
	if (status != DVSM_OK)
		return dio_status_from_engine(status, &fault, error);
	snprintf(made->cpu, sizeof made->cpu, "%s", dvsm_engine_get_cpu(bench->engine));
	made->threads = dvsm_engine_get_threads(bench->engine);
	return DIO_OK;
}

enum dio_status dio_measure_run(struct dio_work *work, const struct dio_measure *wish,
				struct dio_measured *measured, struct dio_error *error)
{
	struct bench bench = {.work = work, .wish = wish};
	struct dio_measured made = {.wish = *wish, .psnr_db = NAN};
	struct dvsm_error fault = {0};
	enum dio_status status;

	forget_peak();
	status = dio_work_use(work, wish->precision, error);
	if (status == DIO_OK)
		status = open_bench(&bench, &made, error);
	if (status == DIO_OK)
		status = dio_status_from_engine(time_reconstruct(&bench, &made, &fault), &fault,
						error);
	if (status == DIO_OK)
		status = dio_status_from_engine(time_render(&bench, &made, &fault), &fault, error);
	made.peak_bytes = read_peak_bytes();
	if (status == DIO_OK)
		status = compare_targets(&bench, &made, error);
	dvsm_scene_destroy(bench.scene);
	dvsm_engine_destroy(bench.engine);
	dio_picture_deinit(&bench.picture);
	free(bench.views);
	free(bench.rgb);
	if (status == DIO_OK)
		*measured = made;
	return status;
}
