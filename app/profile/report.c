#include "profile/report.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void dio_profile_report_deinit(struct dio_profile_report *report)
{
	free(report->faults);
	free(report->places);
	*report = (struct dio_profile_report){0};
}

/* One element more; NULL and a note when there is no memory. */
static void *grow(struct dio_profile_report *report, void *items, size_t count, size_t size)
{
	void *grown = reallocarray(items, count + 1, size);

	if (!grown)
		report->short_of_memory = true;
	return grown;
}

void dio_profile_report_fault(struct dio_profile_report *report, uint32_t line, const char *format,
			      ...)
{
	struct dio_profile_fault *faults =
		grow(report, report->faults, report->fault_count, sizeof(*faults));
	va_list arguments;

	if (!faults)
		return;
	report->faults = faults;
	faults += report->fault_count++;
	faults->line = line;
	va_start(arguments, format);
	/* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): as in drivers/base/status.c */
	vsnprintf(faults->text, sizeof(faults->text), format, arguments);
	va_end(arguments);
}

void dio_profile_report_place(struct dio_profile_report *report, const char *section,
			      const char *key, uint32_t line)
{
	struct dio_profile_place *places =
		grow(report, report->places, report->place_count, sizeof(*places));

	if (!places)
		return;
	report->places = places;
	places += report->place_count++;
	snprintf(places->section, sizeof(places->section), "%s", section);
	snprintf(places->key, sizeof(places->key), "%s", key);
	places->line = line;
}

uint32_t dio_profile_report_line(const struct dio_profile_report *report, const char *section,
				 const char *key)
{
	for (size_t i = 0; i < report->place_count; i++) {
		const struct dio_profile_place *place = &report->places[i];

		if (strcmp(place->section, section) == 0 && strcmp(place->key, key ? key : "") == 0)
			return place->line;
	}
	return 0;
}

static int by_line(const void *a, const void *b)
{
	uint32_t left = ((const struct dio_profile_fault *)a)->line;
	uint32_t right = ((const struct dio_profile_fault *)b)->line;

	return left < right ? -1 : left > right;
}

void dio_profile_report_sort(struct dio_profile_report *report)
{
	if (report->fault_count)
		qsort(report->faults, report->fault_count, sizeof(*report->faults), by_line);
}
