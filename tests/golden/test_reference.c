/* Every golden case through the reference in double, against the oracle that made the cases. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "support/golden_case.h"
#include "support/reference64.h"

/*
 * The oracle's pictures are bytes over 255 in double, the reference's are floats as the engine's
 * are: half a unit in the last place of 1, which the network passes on about as it is to colours
 * and some times larger to keys and values. The random cases, whose pictures are floats on both
 * sides, agree to 1e-12.
 */
#define RENDER_TOLERANCE 1e-7
#define CACHE_TOLERANCE  1e-6

/* Largest difference; a number that is not finite counts as infinitely wrong. */
static double worst(const double *got, const double *expected, size_t count)
{
	double largest = 0;

	for (size_t i = 0; i < count; i++) {
		double difference = fabs(got[i] - expected[i]);

		if (!(difference <= largest))
			largest = isfinite(difference) ? difference : INFINITY;
	}
	return largest;
}

static double check_cache(const struct support_case *item,
			  const struct support_reference_scene *scene, uint32_t layers)
{
	const double *got[] = {
		support_reference_scene_get_keys(scene, 0),
		support_reference_scene_get_values(scene, 0),
		support_reference_scene_get_keys(scene, layers - 1),
		support_reference_scene_get_values(scene, layers - 1),
	};
	const struct support_array *expected[] = {&item->k0, &item->v0, &item->kl, &item->vl};
	double largest = 0;

	for (int i = 0; i < 4; i++)
		largest = fmax(largest, worst(got[i], expected[i]->data, expected[i]->count));
	return largest;
}

static double check_pictures(const struct support_case *item,
			     const struct support_reference *reference,
			     const struct support_reference_scene *scene)
{
	double largest = 0;
	size_t at = 0;

	for (uint32_t i = 0; i < item->target_count; i++) {
		const struct dvsm_camera *target = &item->targets[i];
		size_t numbers = (size_t)target->width * target->height * 3;
		double *rgb = calloc(numbers, sizeof(*rgb));

		assert_non_null(rgb);
		assert_true(at + numbers <= item->render.count);
		support_reference_render(reference, scene, target, item->render_patch_px, rgb);
		largest = fmax(largest, worst(rgb, item->render.data + at, numbers));
		at += numbers;
		free(rgb);
	}
	assert_int_equal(at, item->render.count);
	return largest;
}

static void every_case_agrees_with_the_oracle(void **state)
{
	static char folders[SUPPORT_MAX_CASES][1024];
	size_t count = support_case_list(folders);

	(void)state;
	if (count == 0) {
		printf("skipped: no golden cases\n");
		skip();
	}
	for (size_t i = 0; i < count; i++) {
		struct support_case *item = support_case_read(folders[i]);

		assert_non_null(item);

		struct support_reference *reference = support_reference_open(item->model_path);

		assert_non_null(reference);

		uint32_t layers = support_reference_get_config(reference)->layers;
		struct support_reference_scene *scene = support_reference_reconstruct(
			reference, item->views, item->view_count, item->recon_patch_px);
		size_t numbers = support_reference_scene_get_tokens(scene) *
				 support_reference_get_config(reference)->dim;

		assert_int_equal(numbers, item->k0.count);

		double cache = check_cache(item, scene, layers);
		double pictures = check_pictures(item, reference, scene);

		printf("%-16s render %.1e  cache %.1e\n", item->name, pictures, cache);
		if (!(pictures <= RENDER_TOLERANCE) || !(cache <= CACHE_TOLERANCE))
			fail_msg("%s: render off by %g, keys and values by %g", item->name,
				 pictures, cache);
		support_reference_scene_free(scene);
		support_reference_close(reference);
		support_case_free(item);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_case_agrees_with_the_oracle),
	};

	setvbuf(stdout, NULL, _IOLBF, 0);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
