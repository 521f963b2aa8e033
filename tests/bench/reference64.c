/* Writes the targets of a scene as the reference in double renders them. */
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/model_choice.h"
#include "core/scene_file.h"
#include "core/view.h"
#include "support/reference64.h"

static const char usage[] =
	"Usage: reference64 --scene SCENE.json --out FILE.npy [OPTION...]\n"
	"Reconstruct a scene and render its targets in double precision: what the errors of the\n"
	"engine's precisions are measured against. FILE.npy holds float64 [n, height, width, 3],\n"
	"not clamped. One thread; minutes for a large model.\n"
	"\n"
	"  --model FILE      weights (default: the shipped model)\n"
	"  --patch-recon P   patch side of reconstruction in pixels (default: as diorama chooses)\n"
	"  --patch-render P  patch side of rendering in pixels (default: as diorama chooses)\n"
	"  --targets N       only the first N targets\n";

struct job {
	const char *model, *scene, *out;
	uint32_t patch_recon, patch_render, targets;
};

static void fail(const char *text)
{
	fprintf(stderr, "reference64: %s\n", text);
	exit(1);
}

static void must(enum dio_status status, const struct dio_error *error)
{
	if (status != DIO_OK)
		fail(error->text);
}

static uint32_t number(const char *text)
{
	char *end;
	unsigned long value = strtoul(text, &end, 10);

	if (*end || end == text || value < 1 || value > 65536) {
		fprintf(stderr, "reference64: '%s' is not a number of 1..65536\n", text);
		exit(2);
	}
	return (uint32_t)value;
}

static struct job parse(int argc, char **argv)
{
	static const struct option options[] = {
		{"model", 1, NULL, 'm'},        {"scene", 1, NULL, 's'},
		{"out", 1, NULL, 'o'},          {"patch-recon", 1, NULL, 'c'},
		{"patch-render", 1, NULL, 'r'}, {"targets", 1, NULL, 't'},
		{"help", 0, NULL, 'h'},         {NULL, 0, NULL, 0},
	};
	struct job job = {.targets = UINT32_MAX};
	int option;

	while ((option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		switch (option) {
		case 'm':
			job.model = optarg;
			break;
		case 's':
			job.scene = optarg;
			break;
		case 'o':
			job.out = optarg;
			break;
		case 'c':
			job.patch_recon = number(optarg);
			break;
		case 'r':
			job.patch_render = number(optarg);
			break;
		case 't':
			job.targets = number(optarg);
			break;
		default:
			fputs(usage, option == 'h' ? stdout : stderr);
			exit(option == 'h' ? 0 : 2);
		}
	}
	if (!job.scene || !job.out || optind != argc) {
		fputs(usage, stderr);
		exit(2);
	}
	return job;
}

/* The context as the engine takes it; the pictures live as long as the program. */
static struct dvsm_view *make_views(const struct dio_view_set *set)
{
	struct dvsm_view *views = support_reference_allocate(set->context_count, sizeof(*views));

	for (uint32_t i = 0; i < set->context_count; i++) {
		const struct dio_view *from = &set->context[i];
		size_t numbers = (size_t)from->camera.width * from->camera.height * 3;
		float *rgb = support_reference_allocate(numbers, sizeof(*rgb));

		for (size_t n = 0; n < numbers; n++)
			rgb[n] = (float)from->picture.rgb[n] / 255.0f;
		views[i].camera = dio_view_engine_camera(&from->camera, &from->pose);
		views[i].rgb = rgb;
	}
	return views;
}

static uint32_t choose_patch(uint32_t wished, uint32_t tokens, uint32_t patch_px,
			     const struct dio_camera_model *camera)
{
	return wished ? wished
		      : dio_model_choose_patch(tokens, patch_px, camera->width, camera->height);
}

/* NumPy format 1.0: a Python dictionary, padded so that the numbers begin at byte 128. */
static void write_header(FILE *file, uint32_t count, uint32_t height, uint32_t width)
{
	char dictionary[118];

	snprintf(dictionary, sizeof(dictionary),
		 "{'descr': '<f8', 'fortran_order': False, 'shape': (%u, %u, %u, 3), }", count,
		 height, width);
	fwrite("\x93NUMPY\x01\x00\x76\x00", 1, 10, file);
	fprintf(file, "%-117s\n", dictionary);
}

static void write_targets(const struct job *job, const struct dio_view_set *set, uint32_t tokens,
			  const struct support_reference *reference,
			  const struct support_reference_scene *scene)
{
	const uint32_t count = set->target_count < job->targets ? set->target_count : job->targets;
	const struct dio_camera_model *first = &set->target[0].camera;
	const size_t numbers = (size_t)first->width * first->height * 3;
	double *rgb = support_reference_allocate(numbers, sizeof(*rgb));
	FILE *file = fopen(job->out, "wb");

	if (!file)
		fail("the output file cannot be made");
	write_header(file, count, first->height, first->width);
	for (uint32_t i = 0; i < count; i++) {
		const struct dio_view *target = &set->target[i];
		const struct dvsm_camera camera =
			dio_view_engine_camera(&target->camera, &target->pose);

		if (camera.width != first->width || camera.height != first->height)
			fail("the targets differ in size: one array cannot hold them");
		support_reference_render(
			reference, scene, &camera,
			choose_patch(job->patch_render, tokens,
				     support_reference_get_config(reference)->patch_px,
				     &target->camera),
			rgb);
		fwrite(rgb, sizeof(*rgb), numbers, file);
	}
	if (ferror(file) || fclose(file) != 0)
		fail("the output file cannot be written");
	free(rgb);
}

int main(int argc, char **argv)
{
	const struct job job = parse(argc, argv);
	struct dio_scene_file file = {0};
	struct dio_view_set set = {0};
	struct dio_error error = {0};
	char *shipped = NULL;
	struct dio_model_card card = {0};

	if (!job.model)
		must(dio_model_find_shipped(&shipped, &error), &error);

	const char *path = job.model ? job.model : shipped;

	must(dio_model_read_card(path, &card, &error), &error);
	must(dio_scene_file_read(job.scene, &file, &error), &error);
	must(dio_view_set_load(&file, DIO_LOAD_CONTEXT, &set, &error), &error);
	if (set.target_count == 0)
		fail("the scene has no targets");

	struct support_reference *reference = support_reference_open(path);

	if (!reference)
		return 1;

	struct dvsm_view *views = make_views(&set);
	struct support_reference_scene *scene = support_reference_reconstruct(
		reference, views, set.context_count,
		choose_patch(job.patch_recon, card.tokens_per_view,
			     support_reference_get_config(reference)->patch_px,
			     &set.context[0].camera));

	write_targets(&job, &set, card.tokens_per_view, reference, scene);
	support_reference_scene_free(scene);
	support_reference_close(reference);
	for (uint32_t i = 0; i < set.context_count; i++) {
		void *rgb;

		/* The view borrows its picture as const; here it is owned. */
		memcpy(&rgb, &views[i].rgb, sizeof(rgb));
		free(rgb);
	}
	free(views);
	free(shipped);
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&file);
	return 0;
}
