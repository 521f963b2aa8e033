#include "stress/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "support/reference64.h"

#define MAX_FIGURES 8192u

struct kept {
	char group[16], name[64], precision[16], what[64], fault[160];
	enum stress_judgement judgement;
	double value, limit;
	bool good;
};

struct stress_report {
	struct kept *figures; /* [MAX_FIGURES] */
	size_t count, failures;
};

struct stress_report *stress_report_make(void)
{
	struct stress_report *report = support_reference_allocate(1, sizeof(*report));

	report->figures = support_reference_allocate(MAX_FIGURES, sizeof(report->figures[0]));
	return report;
}

void stress_report_free(struct stress_report *report)
{
	free(report->figures);
	free(report);
}

static void print_kept(const struct kept *kept)
{
	static const char *const relations[] = {"<=", ">=", ""};

	printf("%-4s %-10s %-34s %-6s %-28s ", kept->good ? "ok" : "FAIL", kept->group, kept->name,
	       kept->precision, kept->what);
	if (kept->fault[0])
		printf("%s\n", kept->fault);
	else if (kept->judgement == STRESS_STATED)
		printf("%.3g\n", kept->value);
	else
		printf("%.3g %s %.3g\n", kept->value, relations[kept->judgement], kept->limit);
}

static struct kept *keep(struct stress_report *report, const struct stress_figure *figure)
{
	if (report->count == MAX_FIGURES) {
		fprintf(stderr, "stress: more than %u figures\n", MAX_FIGURES);
		exit(1);
	}

	struct kept *kept = &report->figures[report->count++];

	snprintf(kept->group, sizeof(kept->group), "%s", figure->group);
	snprintf(kept->name, sizeof(kept->name), "%s", figure->name);
	snprintf(kept->precision, sizeof(kept->precision), "%s", figure->precision);
	snprintf(kept->what, sizeof(kept->what), "%s", figure->what);
	kept->judgement = figure->judgement;
	kept->value = figure->value;
	kept->limit = figure->limit;
	return kept;
}

static bool is_good(const struct stress_figure *figure)
{
	switch (figure->judgement) {
	case STRESS_AT_MOST:
		return figure->value <= figure->limit;
	case STRESS_AT_LEAST:
		return figure->value >= figure->limit;
	case STRESS_STATED:
		break;
	}
	return !isnan(figure->value);
}

void stress_report_add(struct stress_report *report, const struct stress_figure *figure)
{
	struct kept *kept = keep(report, figure);

	kept->good = is_good(figure);
	report->failures += !kept->good;
	print_kept(kept);
}

void stress_report_fault(struct stress_report *report, const struct stress_figure *about,
			 const char *fault)
{
	struct kept *kept = keep(report, about);

	snprintf(kept->fault, sizeof(kept->fault), "%s", fault);
	report->failures++;
	print_kept(kept);
}

void stress_report_summarise(const struct stress_report *report)
{
	printf("\n%zu figures, %zu of them bad\n", report->count, report->failures);
	for (size_t i = 0; i < report->count; i++) {
		if (!report->figures[i].good)
			print_kept(&report->figures[i]);
	}
}

size_t stress_report_get_failures(const struct stress_report *report)
{
	return report->failures;
}

/* A text of ours in quotation marks; what JSON would have escaped becomes a space. */
static void write_text(FILE *file, const char *key, const char *text)
{
	fprintf(file, "\"%s\": \"", key);
	for (; *text; text++)
		fputc(*text == '"' || *text == '\\' || (unsigned char)*text < ' ' ? ' ' : *text,
		      file);
	fputs("\", ", file);
}

/* JSON has no infinity. */
static void write_number(FILE *file, const char *key, double value)
{
	if (isfinite(value))
		fprintf(file, "\"%s\": %.6g, ", key, value);
	else
		fprintf(file, "\"%s\": null, ", key);
}

static void write_kept(FILE *file, const struct kept *kept)
{
	static const char *const judgements[] = {"at most", "at least", "stated"};

	fputs("  {", file);
	write_text(file, "group", kept->group);
	write_text(file, "name", kept->name);
	write_text(file, "precision", kept->precision);
	write_text(file, "what", kept->what);
	if (kept->fault[0]) {
		write_text(file, "fault", kept->fault);
	} else {
		write_number(file, "value", kept->value);
		write_text(file, "judgement", judgements[kept->judgement]);
		if (kept->judgement != STRESS_STATED)
			write_number(file, "limit", kept->limit);
	}
	fprintf(file, "\"good\": %s}", kept->good ? "true" : "false");
}

bool stress_report_write(const struct stress_report *report, const char *path)
{
	FILE *file = fopen(path, "w");

	if (!file) {
		perror(path);
		return false;
	}
	fputs("[\n", file);
	for (size_t i = 0; i < report->count; i++) {
		write_kept(file, &report->figures[i]);
		fputs(i + 1 < report->count ? ",\n" : "\n", file);
	}
	fputs("]\n", file);

	bool failed = ferror(file);

	if (fclose(file) != 0 || failed) {
		perror(path);
		return false;
	}
	return true;
}
