/*
 * The engine far from what it was made for: adversarial weights, pictures and rigs, error growth
 * against the reference in double, invariances, and a long render loop.
 */
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stress/world.h"

static const char usage[] =
	"Usage: stress [OPTION...]\n"
	"\n"
	"  --quick            a minute at most: fewer sizes, a shorter loop\n"
	"  --threads N        of each engine (2)\n"
	"  --precision P      f32, bf16 or fixed alone (all that the build has)\n"
	"  --seed N           of the random weights and noise (1, as the limits of extremes)\n"
	"  --part NAME        extremes, growth, invariants or loop alone; may be repeated\n"
	"  --out DIR          write stress.json and the plots there\n";

static const struct {
	const char *name;
	void (*run)(const struct stress_job *job);
} parts[] = {
	{"extremes", stress_extremes},
	{"growth", stress_growth},
	{"invariants", stress_invariants},
	{"loop", stress_loop},
};

#define PARTS (sizeof(parts) / sizeof(parts[0]))

struct wish {
	bool part[PARTS], any_part;
	const char *precision;
};

static void wrong(const char *what, const char *value)
{
	fprintf(stderr, "stress: %s '%s'\n%s", what, value, usage);
	exit(2);
}

static void choose_part(struct wish *wish, const char *name)
{
	for (size_t i = 0; i < PARTS; i++) {
		if (strcmp(parts[i].name, name) == 0) {
			wish->part[i] = wish->any_part = true;
			return;
		}
	}
	wrong("no such part:", name);
}

static struct stress_job parse(int argc, char **argv, struct wish *wish)
{
	static const struct option options[] = {
		{"quick", 0, NULL, 'q'},     {"threads", 1, NULL, 't'}, {"part", 1, NULL, 'p'},
		{"precision", 1, NULL, 'n'}, {"out", 1, NULL, 'o'},     {"help", 0, NULL, 'h'},
		{"seed", 1, NULL, 's'},      {NULL, 0, NULL, 0},
	};
	struct stress_job job = {.threads = 2, .seed = 1};
	int option;

	while ((option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		switch (option) {
		case 'q':
			job.quick = true;
			break;
		case 't':
			job.threads = (uint32_t)strtoul(optarg, NULL, 10);
			break;
		case 's':
			job.seed = strtoull(optarg, NULL, 0);
			break;
		case 'p':
			choose_part(wish, optarg);
			break;
		case 'n':
			wish->precision = optarg;
			break;
		case 'o':
			job.folder = optarg;
			break;
		default:
			fputs(usage, option == 'h' ? stdout : stderr);
			exit(option == 'h' ? 0 : 2);
		}
	}
	if (job.threads < 1 || job.threads > 256)
		wrong("threads are 1 to 256:", "--threads");
	return job;
}

/* All precisions, or the one that was asked for. */
static void choose_precisions(struct stress_job *job, const char *name)
{
	enum dvsm_precision all[STRESS_PRECISIONS];
	size_t count = stress_precisions(all);

	for (size_t i = 0; i < count; i++) {
		if (!name || strcmp(dvsm_precision_name(all[i]), name) == 0)
			job->precisions[job->precision_count++] = all[i];
	}
	if (job->precision_count == 0)
		wrong("this build has no precision", name ? name : "at all");
}

int main(int argc, char **argv)
{
	struct wish wish = {0};
	struct stress_job job = parse(argc, argv, &wish);
	bool written = true;

	setvbuf(stdout, NULL, _IOLBF, 0);
	choose_precisions(&job, wish.precision);
	job.report = stress_report_make();
	for (size_t i = 0; i < PARTS; i++) {
		if (!wish.any_part || wish.part[i])
			parts[i].run(&job);
	}
	stress_report_summarise(job.report);
	if (job.folder) {
		char path[1024];

		snprintf(path, sizeof(path), "%s/stress.json", job.folder);
		written = stress_report_write(job.report, path);
	}

	size_t failures = stress_report_get_failures(job.report);

	stress_report_free(job.report);
	return failures == 0 && written ? 0 : 1;
}
