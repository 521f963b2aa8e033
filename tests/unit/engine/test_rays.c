#include "geometry/rays.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "rig_fixture.h"

static void the_grid_rounds_half_up_and_is_never_empty(void **state)
{
	(void)state;
	static const struct {
		uint32_t width, height, patch, columns, rows;
	} cases[] = {
		{48, 32, 8, 6, 4}, {12, 11, 8, 2, 1},      {4, 3, 8, 1, 1},
		{1, 1, 256, 1, 1}, {960, 540, 16, 60, 34}, {16384, 16384, 1, 16384, 16384},
		{51, 37, 8, 6, 5}, {5, 7, 2, 3, 4},        {384, 383, 256, 2, 1},
	};
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		struct dvsm_token_grid grid =
			dvsm_token_grid_of(cases[i].width, cases[i].height, cases[i].patch);
		assert_int_equal(grid.columns, cases[i].columns);
		assert_int_equal(grid.rows, cases[i].rows);
		assert_int_equal(dvsm_token_grid_count(grid), cases[i].columns * cases[i].rows);
	}
}

/* MODEL.md section 3 written out plainly, pixel (u, v) of a map of w x h. */
static void plain_ray(const struct dvsm_camera *camera, const struct dvsm_normalisation *n,
		      double w, double h, double u, double v, double out[6])
{
	const double *pose = camera->world_from_camera;
	double fx = camera->fx * w / camera->width, fy = camera->fy * h / camera->height;
	double cx = (camera->cx + 0.5) * w / camera->width - 0.5;
	double cy = (camera->cy + 0.5) * h / camera->height - 0.5;
	double local[3] = {(u - cx) / fx, (v - cy) / fy, 1}, world[3], d[3], o[3], moved[3];
	for (int i = 0; i < 3; i++) {
		world[i] = 0;
		for (int j = 0; j < 3; j++)
			world[i] += pose[4 * i + j] * local[j];
		moved[i] = pose[4 * i + 3] - n->origin[i];
	}
	for (int i = 0; i < 3; i++) {
		d[i] = o[i] = 0;
		for (int j = 0; j < 3; j++) {
			d[i] += n->axes[3 * i + j] * world[j];
			o[i] += n->scale * n->axes[3 * i + j] * moved[j];
		}
	}
	double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
	for (int i = 0; i < 3; i++)
		d[i] /= length;
	out[0] = o[1] * d[2] - o[2] * d[1];
	out[1] = o[2] * d[0] - o[0] * d[2];
	out[2] = o[0] * d[1] - o[1] * d[0];
	memcpy(out + 3, d, sizeof(d));
}

static void check_map(uint32_t width, uint32_t height, uint32_t q, uint32_t p)
{
	struct dvsm_camera rig[3];
	rig_make_arc(rig, 3);
	rig[1].width = width;
	rig[1].height = height;
	struct dvsm_normalisation n = dvsm_normalisation_compute(rig, 3);
	struct dvsm_ray_map map = dvsm_ray_map_prepare(&rig[1], &n, q, p);
	size_t tokens = dvsm_token_grid_count(map.grid), patch = (size_t)q * q * 6;
	float *patches = malloc(tokens * patch * sizeof(*patches));
	assert_non_null(patches);
	dvsm_ray_map_write(&map, 0, tokens, patches);

	uint32_t w = map.grid.columns * q, h = map.grid.rows * q;
	for (uint32_t v = 0; v < h; v++) {
		for (uint32_t u = 0; u < w; u++) {
			double expected[6];
			plain_ray(&rig[1], &n, w, h, u, v, expected);
			size_t token = (size_t)(v / q) * map.grid.columns + u / q;
			const float *six = patches + token * patch + (v % q * q + u % q) * 6;
			for (int c = 0; c < 6; c++)
				assert_true(fabs(six[c] - expected[c]) <= 1.3e-7);
		}
	}
	free(patches);
}

static void the_map_agrees_with_the_plain_formula(void **state)
{
	(void)state;
	check_map(48, 32, 8, 8);
	check_map(48, 32, 8, 16);
	check_map(48, 32, 4, 3);
	check_map(51, 37, 8, 8);
	check_map(5, 3, 8, 16);
	check_map(1, 1, 1, 1);
}

static void any_share_of_the_tokens_gives_the_same_bits(void **state)
{
	(void)state;
	struct dvsm_camera rig[2];
	rig_make_arc(rig, 2);
	struct dvsm_normalisation n = dvsm_normalisation_compute(rig, 2);
	struct dvsm_ray_map map = dvsm_ray_map_prepare(&rig[0], &n, 4, 4);
	size_t tokens = dvsm_token_grid_count(map.grid), patch = 4 * 4 * 6;
	float *whole = calloc(tokens * patch, sizeof(float));
	float *shared = calloc(tokens * patch, sizeof(float));
	assert_true(whole && shared);
	dvsm_ray_map_write(&map, 0, tokens, whole);
	for (size_t first = 0; first < tokens; first += 7)
		dvsm_ray_map_write(&map, first, tokens - first < 7 ? tokens - first : 7,
				   shared + first * patch);
	assert_memory_equal(whole, shared, tokens * patch * sizeof(float));
	free(whole);
	free(shared);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_grid_rounds_half_up_and_is_never_empty),
		cmocka_unit_test(the_map_agrees_with_the_plain_formula),
		cmocka_unit_test(any_share_of_the_tokens_gives_the_same_bits),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
