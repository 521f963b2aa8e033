/* Time of reconstruction and rendering with random weights of a given size. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/random_model.h"

#define MAX_RUNS 1000

struct setup {
	uint32_t dim, heads, layers, patch_px, mlp_ratio;
	uint32_t side_px, views, threads, runs;
	uint32_t cpu_mask;
	enum dvsm_precision precision;
};

static const char usage[] =
	"Usage: bench_engine [OPTION...]\n"
	"Median time of reconstruct and render on random weights and pictures.\n"
	"\n"
	"  --dim D        token width (384)\n"
	"  --heads H      attention heads (6)\n"
	"  --layers L     blocks (8)\n"
	"  --patch Q      patch side (16)\n"
	"  --side S       picture side in pixels; (S/Q)^2 tokens a view (256)\n"
	"  --views V      context views (4)\n"
	"  --threads T    0 for all processors (0)\n"
	"  --precision P  f32 or bf16 (f32)\n"
	"  --runs N       timed runs of each, after one that is not (7)\n"
	"  --cpu TIER     scalar, sse2, avx2, avx512, avx512bf16, amx, neon, ... (the best)\n";

static uint32_t number(const char *text)
{
	char *end;
	unsigned long value = strtoul(text, &end, 10);

	if (*end || end == text || value > 65536) {
		fprintf(stderr, "bench_engine: '%s' is not a number of 0..65536\n", text);
		exit(2);
	}
	return (uint32_t)value;
}

static uint32_t tier(const char *name)
{
	for (uint32_t cpu = DVSM_CPU_SCALAR; cpu <= DVSM_CPU_NEON_BF16; cpu <<= 1) {
		if (strcmp(dvsm_cpu_name(cpu), name) == 0 && (dvsm_cpu_detect() & cpu))
			return cpu;
	}
	fprintf(stderr, "bench_engine: this machine has no tier '%s'\n", name);
	exit(2);
}

static enum dvsm_precision precision(const char *name)
{
	for (int i = DVSM_PRECISION_F32; i <= DVSM_PRECISION_FIXED; i++) {
		if (strcmp(dvsm_precision_name((enum dvsm_precision)i), name) == 0)
			return (enum dvsm_precision)i;
	}
	fprintf(stderr, "bench_engine: '%s' is not f32, bf16 or fixed\n", name);
	exit(2);
}

static struct setup parse(int argc, char **argv)
{
	static const struct option options[] = {
		{"dim", 1, NULL, 'd'},       {"heads", 1, NULL, 'h'}, {"layers", 1, NULL, 'l'},
		{"patch", 1, NULL, 'p'},     {"side", 1, NULL, 's'},  {"views", 1, NULL, 'v'},
		{"threads", 1, NULL, 't'},   {"runs", 1, NULL, 'n'},  {"cpu", 1, NULL, 'c'},
		{"precision", 1, NULL, 'x'}, {"help", 0, NULL, '?'},  {NULL, 0, NULL, 0},
	};
	struct setup setup = {384, 6, 8, 16, 4, 256, 4, 0, 7, 0, DVSM_PRECISION_F32};
	int option;

	while ((option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		switch (option) {
		case 'd':
			setup.dim = number(optarg);
			break;
		case 'h':
			setup.heads = number(optarg);
			break;
		case 'l':
			setup.layers = number(optarg);
			break;
		case 'p':
			setup.patch_px = number(optarg);
			break;
		case 's':
			setup.side_px = number(optarg);
			break;
		case 'v':
			setup.views = number(optarg);
			break;
		case 't':
			setup.threads = number(optarg);
			break;
		case 'n':
			setup.runs = number(optarg);
			break;
		case 'x':
			setup.precision = precision(optarg);
			break;
		case 'c':
			setup.cpu_mask = tier(optarg);
			break;
		default:
			fputs(usage, stdout);
			exit(optind > 1 && strcmp(argv[optind - 1], "--help") == 0 ? 0 : 2);
		}
	}
	if (setup.heads < 1 || setup.dim % setup.heads != 0 || setup.dim < 1 || setup.layers < 1 ||
	    setup.patch_px < 1 || setup.side_px < 1 || setup.views < 1 || setup.runs < 1 ||
	    setup.runs > MAX_RUNS) {
		fputs("bench_engine: sizes are at least 1, heads divide dim\n", stderr);
		exit(2);
	}
	return setup;
}

static void must(enum dvsm_status status, const struct dvsm_error *error)
{
	if (status == DVSM_OK)
		return;
	fprintf(stderr, "bench_engine: %s\n", error->text);
	exit(1);
}

static int compare(const void *a, const void *b)
{
	const uint64_t *x = a, *y = b;

	return (*x > *y) - (*x < *y);
}

static void report(const char *what, uint64_t *times_ns, uint32_t runs, double flops)
{
	qsort(times_ns, runs, sizeof(times_ns[0]), compare);

	double median = (double)times_ns[runs / 2];

	printf("%-12s median %8.2f ms  best %8.2f ms  worst %8.2f ms  %7.1f GFLOP/s\n", what,
	       median / 1e6, (double)times_ns[0] / 1e6, (double)times_ns[runs - 1] / 1e6,
	       flops / median);
}

/* Multiplications and additions of the matrix products and of attention, nothing else. */
static double half_flops(const struct setup *s, double queries, double keys, double projections)
{
	double dim = s->dim;

	return queries * 2 * dim * dim * (projections + 1 + 2.0 * s->mlp_ratio) +
	       queries * keys * 4 * dim;
}

static double render_flops(const struct setup *s, double tokens)
{
	double area = (double)s->patch_px * s->patch_px, dim = s->dim;

	return s->layers * (half_flops(s, tokens, tokens, 3) +
			    half_flops(s, tokens, tokens * s->views, 1)) +
	       tokens * 2 * dim * area * (6 + 3);
}

static double reconstruct_flops(const struct setup *s, double tokens)
{
	double area = (double)s->patch_px * s->patch_px, dim = s->dim, all = tokens * s->views;

	return s->layers * half_flops(s, all, tokens, 3) +
	       (s->layers - 1) * half_flops(s, all, all, 3) + all * 2 * dim * dim * 2 +
	       all * 2 * dim * area * (6 + 3);
}

static struct dvsm_view *make_views(const struct setup *setup, struct support_random *random)
{
	size_t numbers = (size_t)setup->side_px * setup->side_px * 3;
	struct dvsm_view *views = calloc(setup->views, sizeof(*views));
	float *rgb = malloc(setup->views * numbers * sizeof(float));

	if (!views || !rgb)
		must(DVSM_NO_MEM, &(struct dvsm_error){"no memory for the pictures"});
	support_random_fill(random, rgb, setup->views * numbers, 1.0f);
	for (uint32_t v = 0; v < setup->views; v++) {
		views[v].camera = support_ring_camera(setup->side_px, setup->side_px, 2 * v,
						      2 * setup->views);
		views[v].rgb = rgb + v * numbers;
	}
	return views;
}

int main(int argc, char **argv)
{
	static uint64_t recon_ns[MAX_RUNS + 1], render_ns[MAX_RUNS + 1];
	const struct setup setup = parse(argc, argv);
	const struct dvsm_model_config config = {
		.dim = setup.dim,
		.heads = setup.heads,
		.layers = setup.layers,
		.patch_px = setup.patch_px,
		.mlp_ratio = setup.mlp_ratio,
		.norm_eps = 1e-6,
	};
	const struct dvsm_engine_options options = {
		.threads = setup.threads, .cpu_mask = setup.cpu_mask, .precision = setup.precision};
	struct support_random random = {1};
	struct dvsm_model *model = support_random_model(&config, &random);
	struct dvsm_view *views = make_views(&setup, &random);
	float *picture = malloc((size_t)setup.side_px * setup.side_px * 3 * sizeof(float));
	struct dvsm_camera target =
		support_ring_camera(setup.side_px, setup.side_px, 1, 2 * setup.views);
	struct dvsm_engine *engine;
	struct dvsm_scene *scene = NULL;
	struct dvsm_stats recon, render;
	struct dvsm_error error = {"no memory for the model"};

	must(model && picture ? DVSM_OK : DVSM_NO_MEM, &error);
	must(dvsm_engine_create(model, &options, &engine, &error), &error);
	for (uint32_t i = 0; i <= setup.runs; i++) {
		dvsm_scene_destroy(scene);
		must(dvsm_reconstruct(engine, views, setup.views, 0, NULL, NULL, &scene, &recon,
				      &error),
		     &error);
		recon_ns[i] = recon.time_ns;
	}
	for (uint32_t i = 0; i <= setup.runs; i++) {
		must(dvsm_render(engine, scene, &target, 0, picture, &render, &error), &error);
		render_ns[i] = render.time_ns;
	}

	printf("D %u, %u heads, %u blocks, %u tokens a view, %u views, %s, %u threads\n", setup.dim,
	       setup.heads, setup.layers, render.tokens, setup.views, dvsm_engine_get_cpu(engine),
	       dvsm_engine_get_threads(engine));
	report("reconstruct", recon_ns + 1, setup.runs, reconstruct_flops(&setup, render.tokens));
	report("render", render_ns + 1, setup.runs, render_flops(&setup, render.tokens));
	printf("memory       weights %.1f MB  cache %.1f MB  workspace %.1f MB\n",
	       (double)render.memory.weights_bytes / 1e6, (double)render.memory.cache_bytes / 1e6,
	       (double)render.memory.workspace_bytes / 1e6);

	/* The pictures lie in one block that the first view begins. */
	void *rgb;

	memcpy(&rgb, &views[0].rgb, sizeof(rgb));
	free(rgb);
	free(views);
	free(picture);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
	dvsm_model_close(model);
	return 0;
}
