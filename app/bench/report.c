#include "bench/report.h"

#include <math.h>
#include <stdio.h>

#include "core/json_out.h"

#define MIB (1024.0 * 1024.0)

double dio_report_rate(const struct dio_times *times)
{
	return times->operations / (times->median_ms * 1e-3);
}

double dio_report_share(const struct dio_outcome *outcome, const struct dio_measured *measured,
			const struct dio_times *times)
{
	const struct dio_peak_unit *unit =
		dio_peak_for(dio_outcome_peak(outcome, measured), measured->wish.precision);

	return unit->instruction ? dio_report_rate(times) / unit->operations_per_s : NAN;
}

void dio_report_print_head(const struct dio_report *report, const struct dio_outcome *outcome)
{
	const struct dio_machine *machine = report->machine;
	const struct dvsm_model_config *config = &report->work->config;
	const struct dio_camera_model *camera = &report->work->views.target[0].camera;

	printf("machine  %s, %u processors, %.1f GiB, last cache %.0f MiB; %s; %s; %s\n",
	       machine->processor, machine->processors, (double)machine->memory_bytes / MIB / 1024,
	       (double)machine->last_cache_bytes / MIB, machine->tiers, machine->system,
	       machine->compiler);
	for (uint32_t i = 0; i < outcome->peak_count; i++) {
		const struct dio_peak *peak = &outcome->peaks[i];

		printf("peak     %u thread%s:", peak->threads, peak->threads == 1 ? "" : "s");
		for (int unit = 0; unit < DIO_UNIT_COUNT; unit++)
			if (peak->units[unit].instruction)
				printf(" %s %.0f GOP/s (%s),", dio_unit_name(unit),
				       peak->units[unit].operations_per_s * 1e-9,
				       peak->units[unit].instruction);
		printf(" memory read at %.1f GB/s\n", peak->read_bytes_per_s * 1e-9);
	}
	printf("work     %s: D %u, %u heads, %u blocks, patch %u; %s, target %ux%u\n",
	       report->work->model_name, config->dim, config->heads, config->layers,
	       config->patch_px, report->work->scene_name, camera->width, camera->height);
	printf("times    medians of up to %u runs, +- half the distance of the quartiles; peak %%: "
	       "share of the peak above\n\n",
	       report->sweep->runs);
	printf("%-9s %-10s %7s %5s %5s %6s  %11s %4s %6s %5s  %9s %4s %6s %5s  %8s  %8s %8s  %7s\n",
	       "precision", "tier", "threads", "views", "patch", "tokens", "reconst. ms", "+-%",
	       "GOP/s", "peak%", "render ms", "+-%", "GOP/s", "peak%", "peak MiB", "rms err",
	       "max err", "PSNR dB");
}

static void print_stage(const struct dio_outcome *outcome, const struct dio_measured *measured,
			const struct dio_times *times, int width)
{
	const double share = dio_report_share(outcome, measured, times);

	printf("  %*.2f %4.1f %6.0f ", width, times->median_ms, 100 * dio_times_spread(times),
	       dio_report_rate(times) * 1e-9);
	if (isnan(share))
		printf("%5s", "-");
	else
		printf("%5.1f", 100 * share);
}

void dio_report_print_row(const struct dio_outcome *outcome, const struct dio_measured *measured)
{
	printf("%-9s %-10s %7u %5u %5u %6u", dvsm_precision_name(measured->wish.precision),
	       measured->cpu, measured->threads, measured->wish.views, measured->wish.patch_px,
	       measured->tokens);
	print_stage(outcome, measured, &measured->reconstruct, 11);
	print_stage(outcome, measured, &measured->render, 9);
	printf("  %8.1f", (double)measured->peak_bytes / MIB);
	if (measured->from_reference.known)
		printf("  %8.2e %8.2e", measured->from_reference.rms,
		       measured->from_reference.largest);
	else
		printf("  %8s %8s", "-", "-");
	if (measured->from_truth.known)
		printf("  %7.2f\n", measured->psnr_db);
	else
		printf("  %7s\n", "-");
	fflush(stdout);
}

static cJSON *describe_machine(const struct dio_machine *machine)
{
	cJSON *object = cJSON_CreateObject();

	dio_json_add_text(object, "processor", machine->processor);
	cJSON_AddNumberToObject(object, "processors", machine->processors);
	dio_json_add_text(object, "tiers", machine->tiers);
	dio_json_add_text(object, "system", machine->system);
	dio_json_add_text(object, "compiler", machine->compiler);
	cJSON_AddNumberToObject(object, "memory_bytes", (double)machine->memory_bytes);
	cJSON_AddNumberToObject(object, "last_cache_bytes", (double)machine->last_cache_bytes);
	return object;
}

static cJSON *describe_peak(const struct dio_peak *peak)
{
	cJSON *object = cJSON_CreateObject();

	cJSON_AddNumberToObject(object, "threads", peak->threads);
	for (int i = 0; i < DIO_UNIT_COUNT; i++) {
		cJSON *unit;

		if (!peak->units[i].instruction)
			continue;
		unit = cJSON_AddObjectToObject(object, dio_unit_name(i));
		dio_json_add_text(unit, "instruction", peak->units[i].instruction);
		dio_json_add_number(unit, "gop_per_s", peak->units[i].operations_per_s * 1e-9, 1);
	}
	dio_json_add_number(object, "memory_gb_per_s", peak->read_bytes_per_s * 1e-9, 2);
	return object;
}

static cJSON *describe_work(const struct dio_work *work)
{
	const struct dvsm_model_config *config = &work->config;
	cJSON *object = cJSON_CreateObject();

	dio_json_add_text(object, "model", work->model_name);
	dio_json_add_text(object, "model_sha256", work->model_sha256);
	cJSON_AddNumberToObject(object, "dim", config->dim);
	cJSON_AddNumberToObject(object, "heads", config->heads);
	cJSON_AddNumberToObject(object, "layers", config->layers);
	cJSON_AddNumberToObject(object, "patch", config->patch_px);
	dio_json_add_text(object, "scene", work->scene_name);
	cJSON_AddItemToObject(object, "camera", dio_json_camera(&work->views.target[0].camera));
	cJSON_AddNumberToObject(object, "targets", work->views.target_count);
	return object;
}

static cJSON *describe_stage(const struct dio_outcome *outcome, const struct dio_measured *measured,
			     const struct dio_times *times)
{
	cJSON *object = cJSON_CreateObject();

	dio_json_add_number(object, "median_ms", times->median_ms, 4);
	dio_json_add_number(object, "best_ms", times->best_ms, 4);
	dio_json_add_number(object, "low_quartile_ms", times->low_ms, 4);
	dio_json_add_number(object, "high_quartile_ms", times->high_ms, 4);
	dio_json_add_number(object, "worst_ms", times->worst_ms, 4);
	cJSON_AddNumberToObject(object, "runs", times->runs);
	dio_json_add_number(object, "gop", times->operations * 1e-9, 4);
	dio_json_add_number(object, "gop_per_s", dio_report_rate(times) * 1e-9, 2);
	dio_json_add_number(object, "share_of_peak", dio_report_share(outcome, measured, times), 4);
	return object;
}

static void add_difference(cJSON *object, const char *key, const struct dio_difference *difference)
{
	cJSON *made;

	if (!difference->known)
		return;
	made = cJSON_AddObjectToObject(object, key);
	cJSON_AddNumberToObject(made, "rms", difference->rms);
	cJSON_AddNumberToObject(made, "largest", difference->largest);
}

static cJSON *describe_measured(const struct dio_outcome *outcome,
				const struct dio_measured *measured)
{
	cJSON *object = cJSON_CreateObject(), *memory;

	dio_json_add_text(object, "precision", dvsm_precision_name(measured->wish.precision));
	dio_json_add_text(object, "tier", measured->cpu);
	cJSON_AddNumberToObject(object, "threads", measured->threads);
	cJSON_AddNumberToObject(object, "views", measured->wish.views);
	cJSON_AddNumberToObject(object, "patch", measured->wish.patch_px);
	cJSON_AddNumberToObject(object, "tokens", measured->tokens);
	cJSON_AddItemToObject(object, "reconstruct",
			      describe_stage(outcome, measured, &measured->reconstruct));
	cJSON_AddItemToObject(object, "render",
			      describe_stage(outcome, measured, &measured->render));
	memory = cJSON_AddObjectToObject(object, "memory");
	cJSON_AddNumberToObject(memory, "weights_bytes", (double)measured->memory.weights_bytes);
	cJSON_AddNumberToObject(memory, "cache_bytes", (double)measured->memory.cache_bytes);
	cJSON_AddNumberToObject(memory, "workspace_bytes",
				(double)measured->memory.workspace_bytes);
	cJSON_AddNumberToObject(memory, "process_peak_bytes", (double)measured->peak_bytes);
	add_difference(object, "from_float64", &measured->from_reference);
	add_difference(object, "from_true_pictures", &measured->from_truth);
	if (measured->from_truth.known)
		dio_json_add_number(object, "psnr_db", measured->psnr_db, 4);
	return object;
}

cJSON *dio_report_json(const struct dio_report *report, const struct dio_outcome *outcome)
{
	cJSON *root = cJSON_CreateObject(), *peaks, *measured;

	cJSON_AddItemToObject(root, "machine", describe_machine(report->machine));
	peaks = cJSON_AddArrayToObject(root, "peaks");
	for (uint32_t i = 0; i < outcome->peak_count; i++)
		cJSON_AddItemToArray(peaks, describe_peak(&outcome->peaks[i]));
	cJSON_AddItemToObject(root, "work", describe_work(report->work));
	measured = cJSON_AddArrayToObject(root, "measured");
	for (uint32_t i = 0; i < outcome->count; i++)
		cJSON_AddItemToArray(measured, describe_measured(outcome, &outcome->measured[i]));
	return root;
}
