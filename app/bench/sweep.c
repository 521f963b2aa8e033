#include "bench/sweep.h"

#include <stdlib.h>
#include <string.h>

#include "core/log.h"

enum dio_status dio_list_parse(const char *text, const char *name, uint32_t low, uint32_t high,
			       struct dio_list *list, struct dio_error *error)
{
	struct dio_list made = {0};

	for (const char *at = text;; at++) {
		char *end;
		unsigned long value = strtoul(at, &end, 10);

		if (end == at || *at == '-' || (*end && *end != ',') || value < low || value > high)
			return dio_fail(error, DIO_BAD_ARG,
					"--%s %s: whole numbers from %u to %u, separated by "
					"commas, are wanted",
					name, text, low, high);
		if (made.count == DIO_SWEEP_MAX)
			return dio_fail(error, DIO_BAD_ARG, "--%s %s: more than %u numbers", name,
					text, DIO_SWEEP_MAX);
		for (uint32_t i = 0; i < made.count; i++)
			if (made.values[i] == value)
				return dio_fail(error, DIO_BAD_ARG, "--%s %s: %lu is there twice",
						name, text, value);
		made.values[made.count++] = (uint32_t)value;
		at = end;
		if (!*at)
			break;
	}
	*list = made;
	return DIO_OK;
}

enum dio_status dio_list_parse_precisions(const char *text, struct dio_list *list,
					  struct dio_error *error)
{
	struct dio_list made = {0};

	for (const char *at = text;; at++) {
		const size_t length = strcspn(at, ",");
		bool found = false;

		for (uint32_t p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++) {
			const char *name = dvsm_precision_name(p);

			if (strlen(name) != length || strncmp(at, name, length) != 0)
				continue;
			found = made.count < DIO_SWEEP_MAX;
			if (found)
				made.values[made.count++] = p;
		}
		if (!found)
			return dio_fail(error, DIO_BAD_ARG,
					"--precision %s: f32, bf16 and fixed, separated by commas, "
					"are wanted",
					text);
		at += length;
		if (!*at)
			break;
	}
	*list = made;
	return DIO_OK;
}

static enum dio_status measure_peaks(const struct dio_sweep *sweep, struct dio_outcome *outcome,
				     struct dio_error *error)
{
	enum dio_status status = DIO_OK;

	for (uint32_t i = 0; status == DIO_OK && i < sweep->threads.count; i++) {
		status = dio_peak_measure(sweep->threads.values[i], sweep->cpu_mask,
					  &outcome->peaks[i], error);
		if (status == DIO_OK)
			outcome->peak_count++;
	}
	return status;
}

/* A sweep under way. */
struct run {
	struct dio_work *work;
	const struct dio_sweep *sweep;
	dio_sweep_fn *said;
	const void *context;
	struct dio_outcome outcome;
};

/* One measurement, added to the outcome. */
static enum dio_status measure_one(struct run *run, const struct dio_measure *wish,
				   struct dio_error *error)
{
	const struct dio_sweep *sweep = run->sweep;
	struct dio_outcome *outcome = &run->outcome;
	struct dio_measured *measured = &outcome->measured[outcome->count];
	enum dio_status status = dio_measure_run(run->work, wish, measured, error);

	if (status == DIO_UNSUPPORTED && sweep->any_precision) {
		if (wish->patch_px == sweep->patches.values[0] &&
		    wish->views == sweep->views.values[0] &&
		    wish->threads == sweep->threads.values[0])
			dio_log_note("left out: %s", error->text);
		return DIO_OK;
	}
	if (status != DIO_OK)
		return status;
	outcome->count++;
	measured->wish.reference = NULL; /* which lives no longer than the sweep of one size */
	if (run->said)
		run->said(run->context, outcome, measured);
	return DIO_OK;
}

/* All precisions and numbers of threads for one patch and number of views. */
static enum dio_status measure_size(struct run *run, uint32_t patch_px, uint32_t views,
				    struct dio_error *error)
{
	const struct dio_sweep *sweep = run->sweep;
	struct dio_measure wish = {.patch_px = patch_px,
				   .views = views,
				   .cpu_mask = sweep->cpu_mask,
				   .runs = sweep->runs};
	enum dio_status status = DIO_OK;
	double *reference = NULL;

	if (sweep->reference)
		status = dio_work_read_reference(run->work, sweep->reference, views, patch_px,
						 &reference, &wish.reference_targets, error);
	wish.reference = reference;
	for (uint32_t p = 0; p < sweep->precisions.count; p++) {
		for (uint32_t t = 0; status == DIO_OK && t < sweep->threads.count; t++) {
			wish.precision = sweep->precisions.values[p];
			wish.threads = sweep->threads.values[t];
			status = measure_one(run, &wish, error);
		}
	}
	free(reference);
	return status;
}

enum dio_status dio_sweep_run(struct dio_work *work, const struct dio_sweep *sweep,
			      dio_sweep_fn *said, const void *context, struct dio_outcome *outcome,
			      struct dio_error *error)
{
	const size_t most = (size_t)sweep->precisions.count * sweep->patches.count *
			    sweep->views.count * sweep->threads.count;
	struct run run = {.work = work, .sweep = sweep, .said = said, .context = context};
	enum dio_status status;

	run.outcome.measured = calloc(most, sizeof *run.outcome.measured);
	if (!run.outcome.measured)
		return dio_fail(error, DIO_NO_MEM, "no memory for %zu measurements", most);
	status = measure_peaks(sweep, &run.outcome, error);
	for (uint32_t v = 0; v < sweep->views.count; v++)
		for (uint32_t p = 0; status == DIO_OK && p < sweep->patches.count; p++)
			status = measure_size(&run, sweep->patches.values[p],
					      sweep->views.values[v], error);
	if (status == DIO_OK && run.outcome.count == 0)
		status = dio_fail(error, DIO_UNSUPPORTED, "no precision could be measured");
	if (status == DIO_OK)
		*outcome = run.outcome;
	else
		dio_outcome_deinit(&run.outcome);
	return status;
}

void dio_outcome_deinit(struct dio_outcome *outcome)
{
	free(outcome->measured);
	*outcome = (struct dio_outcome){0};
}

const struct dio_peak *dio_outcome_peak(const struct dio_outcome *outcome,
					const struct dio_measured *measured)
{
	for (uint32_t i = 0; i < outcome->peak_count; i++)
		if (outcome->peaks[i].threads == measured->wish.threads)
			return &outcome->peaks[i];
	return &outcome->peaks[0];
}
