/*
 * The fixed-point path: the bits that engine/FIXED_POINT.md promises to be the same everywhere are
 * written down here. Weights, pictures and cameras are made without a library function that may
 * round in its own way.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dvsm/dvsm.h"
#include "support/random.h"
#include "support/random_model.h"

enum { VIEWS = 3, SIDE = 80, NUMBERS = SIDE * SIDE * 3 };

struct fixture {
	struct dvsm_model *model;
	struct dvsm_view views[VIEWS];
	struct dvsm_camera target;
	float pictures[VIEWS][NUMBERS];
	struct dvsm_error error;
};

/* Three units from the origin, looking at it, turned about y by an angle of a whole triangle. */
static struct dvsm_camera camera_at(double cosine, double sine)
{
	return (struct dvsm_camera){
		.width = SIDE,
		.height = SIDE,
		.fx = 75,
		.fy = 80,
		.cx = 38.5,
		.cy = 41,
		.world_from_camera = {cosine, 0, sine, -3 * sine, 0, 1, 0, 0.25, -sine, 0, cosine,
				      -3 * cosine, 0, 0, 0, 1},
	};
}

static void make_fixture(struct fixture *f, const struct dvsm_model_config *config)
{
	static const double turns[VIEWS][2] = {{1, 0}, {0.8, 0.6}, {0.6, -0.8}};
	struct support_random random = {20261123};

	f->model = support_random_model(config, &random);
	assert_non_null(f->model);
	for (uint32_t v = 0; v < VIEWS; v++) {
		const struct dvsm_camera camera = camera_at(turns[v][0], turns[v][1]);

		f->views[v] = support_random_view(&random, &camera, f->pictures[v]);
	}
	f->target = camera_at(0.96, 0.28);
}

/* Heads that fill a tile, and more keys than one tile of attention holds: 300. */
static const struct dvsm_model_config even = {
	.dim = 128,
	.heads = 2,
	.layers = 2,
	.patch_px = 8,
	.mlp_ratio = 4,
	.norm_eps = 1e-6,
};

/* Nothing fits a tile, pictures are resampled, and colours go through the sigmoid. */
static const struct dvsm_model_config odd = {
	.dim = 36,
	.heads = 4,
	.layers = 3,
	.patch_px = 6,
	.mlp_ratio = 3,
	.norm_eps = 1e-5,
	.rgb_sigmoid = true,
};

static int set_up(void **state)
{
	*state = calloc(1, sizeof(struct fixture));
	assert_non_null(*state);
	make_fixture(*state, &odd);
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *f = *state;

	dvsm_model_close(f->model);
	free(f);
	return 0;
}

static struct dvsm_engine *make_engine(struct fixture *f, enum dvsm_precision precision,
				       uint32_t threads, uint32_t cpu_mask)
{
	const struct dvsm_engine_options options = {
		.threads = threads, .cpu_mask = cpu_mask, .precision = precision};
	struct dvsm_engine *engine = NULL;

	assert_int_equal(dvsm_engine_create(f->model, &options, &engine, &f->error), DVSM_OK);
	return engine;
}

static struct dvsm_scene *make_scene(struct fixture *f, struct dvsm_engine *engine,
				     uint32_t patch_px)
{
	struct dvsm_scene *scene = NULL;

	assert_int_equal(dvsm_reconstruct(engine, f->views, VIEWS, patch_px, NULL, NULL, &scene,
					  NULL, &f->error),
			 DVSM_OK);
	return scene;
}

/* Hashes of the cache and of one picture. */
struct hashes {
	char cache[65], picture[65];
};

static struct hashes hash_scene(struct fixture *f, struct dvsm_engine *engine,
				const struct dvsm_scene *scene, uint32_t patch_px)
{
	static uint8_t picture[NUMBERS];
	struct hashes hashes;

	assert_int_equal(
		dvsm_render_rgb8(engine, scene, &f->target, patch_px, picture, NULL, &f->error),
		DVSM_OK);
	dvsm_scene_hash_cache(scene, hashes.cache);
	dvsm_hash_bytes(picture, sizeof(picture), hashes.picture);
	return hashes;
}

static struct hashes hash_run(struct fixture *f, uint32_t threads, uint32_t cpu_mask,
			      uint32_t patch_px)
{
	struct dvsm_engine *engine = make_engine(f, DVSM_PRECISION_FIXED, threads, cpu_mask);
	struct dvsm_scene *scene = make_scene(f, engine, patch_px);
	struct hashes hashes = hash_scene(f, engine, scene, patch_px);

	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
	return hashes;
}

static void expect_everywhere(const struct dvsm_model_config *config, uint32_t patch_px,
			      const struct hashes *want)
{
	struct fixture *f = calloc(1, sizeof(*f));

	assert_non_null(f);
	make_fixture(f, config);
	for (uint32_t cpu = 1; cpu != 0; cpu <<= 1) {
		if (!(dvsm_cpu_detect() & cpu))
			continue;

		struct hashes got = hash_run(f, 1, cpu, patch_px);

		printf("%-10s cache %.16s picture %.16s\n", dvsm_cpu_name(cpu), got.cache,
		       got.picture);
		assert_string_equal(got.cache, want->cache);
		assert_string_equal(got.picture, want->picture);
	}
	dvsm_model_close(f->model);
	free(f);
}

static void the_bits_are_those_written_down(void **state)
{
	static const struct hashes even_bits = {
		"2231fa176bacc823e57e8a8b239523d7470c685498fae205c9764e9f58ba8021",
		"b084e5c38012eafcb4f876607a17b2cf5c06d228d5b8b584b6abe8a144c791e0",
	};
	static const struct hashes odd_bits = {
		"0abad861bdec410faf45fcb26a83e332990595bb3476893390564d6a34e0902a",
		"79bac3c8d31180bc8cdc76631ba67f1db09ef3c6412f1dfad4a115ff72c1ee48",
	};

	(void)state;
	expect_everywhere(&even, 8, &even_bits);
	expect_everywhere(&odd, 9, &odd_bits);
}

static void the_number_of_threads_changes_no_bit(void **state)
{
	struct hashes one = hash_run(*state, 1, 0, 7);

	for (uint32_t threads = 2; threads <= 5; threads++) {
		struct hashes many = hash_run(*state, threads, 0, 7);

		assert_string_equal(many.cache, one.cache);
		assert_string_equal(many.picture, one.picture);
	}
}

static void order_and_repetition_of_views_change_no_bit(void **state)
{
	static const int orders[][2 * VIEWS] = {{2, 1, 0}, {1, 2, 0}, {0, 1, 2, 2, 0, 1}};
	static const uint32_t counts[] = {VIEWS, VIEWS, 2 * VIEWS};
	struct fixture *f = *state;
	struct hashes want = hash_run(f, 2, 0, 7);
	struct dvsm_engine *engine = make_engine(f, DVSM_PRECISION_FIXED, 2, 0);

	for (int i = 0; i < 3; i++) {
		struct dvsm_view views[2 * VIEWS];
		struct dvsm_scene *scene = NULL;

		for (uint32_t v = 0; v < counts[i]; v++)
			views[v] = f->views[orders[i][v]];
		assert_int_equal(dvsm_reconstruct(engine, views, counts[i], 7, NULL, NULL, &scene,
						  NULL, &f->error),
				 DVSM_OK);
		assert_string_equal(hash_scene(f, engine, scene, 7).picture, want.picture);
		dvsm_scene_destroy(scene);
	}
	dvsm_engine_destroy(engine);
}

static void bytes_are_the_floats_rounded(void **state)
{
	static float colours[NUMBERS];
	static uint8_t bytes[NUMBERS];
	static const enum dvsm_precision precisions[] = {DVSM_PRECISION_F32, DVSM_PRECISION_BF16,
							 DVSM_PRECISION_FIXED};
	struct fixture *f = *state;

	for (int p = 0; p < 3; p++) {
		struct dvsm_engine *engine = make_engine(f, precisions[p], 1, 0);
		struct dvsm_scene *scene = make_scene(f, engine, 0);

		assert_int_equal(
			dvsm_render(engine, scene, &f->target, 0, colours, NULL, &f->error),
			DVSM_OK);
		assert_int_equal(
			dvsm_render_rgb8(engine, scene, &f->target, 0, bytes, NULL, &f->error),
			DVSM_OK);
		for (size_t i = 0; i < NUMBERS; i++) {
			double value = floor((double)colours[i] * 255 + 0.5);

			assert_int_equal(bytes[i], value < 0 ? 0 : value > 255 ? 255 : (int)value);
		}
		dvsm_scene_destroy(scene);
		dvsm_engine_destroy(engine);
	}
}

static double psnr_db(const float *a, const float *b)
{
	double squares = 0;

	for (size_t i = 0; i < NUMBERS; i++)
		squares += ((double)a[i] - b[i]) * ((double)a[i] - b[i]) / NUMBERS;
	return -10 * log10(squares);
}

/* Random weights amplify errors more than trained ones; still what is asked of those holds. */
static void pictures_are_near_float32(void **state)
{
	static float want[NUMBERS], got[NUMBERS];
	struct fixture *f = *state;

	for (int p = 0; p < 2; p++) {
		struct dvsm_engine *engine =
			make_engine(f, p ? DVSM_PRECISION_FIXED : DVSM_PRECISION_F32, 1, 0);
		struct dvsm_scene *scene = make_scene(f, engine, 0);

		assert_int_equal(
			dvsm_render(engine, scene, &f->target, 0, p ? got : want, NULL, &f->error),
			DVSM_OK);
		dvsm_scene_destroy(scene);
		dvsm_engine_destroy(engine);
	}
	printf("fixed is %.1f dB from f32\n", psnr_db(want, got));
	assert_true(psnr_db(want, got) > 42);
}

static void the_cache_takes_a_byte_a_number_and_is_planned(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, DVSM_PRECISION_FIXED, 1, 0);
	struct dvsm_scene *scene = make_scene(f, engine, 0);
	struct dvsm_memory planned;
	struct dvsm_camera cameras[VIEWS];
	uint64_t padded = (dvsm_scene_get_token_count(scene) + 63) / 64 * 64;

	for (uint32_t v = 0; v < VIEWS; v++)
		cameras[v] = f->views[v].camera;
	assert_int_equal(dvsm_plan(engine, cameras, VIEWS, 0, NULL, 0, &planned, &f->error),
			 DVSM_OK);
	/* Tokens are filled up to 64, heads of 9 to 16; the first block's keys also to two of 64.
	 */
	assert_int_equal(dvsm_scene_get_cache_bytes(scene),
			 odd.layers * 2 * padded * odd.heads * 16);
	assert_int_equal(planned.cache_bytes,
			 dvsm_scene_get_cache_bytes(scene) + padded * odd.heads * 2 * 64);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

static void a_scene_of_another_precision_is_refused(void **state)
{
	static float picture[NUMBERS];
	struct fixture *f = *state;
	struct dvsm_engine *wide = make_engine(f, DVSM_PRECISION_F32, 1, 0);
	struct dvsm_engine *fixed = make_engine(f, DVSM_PRECISION_FIXED, 1, 0);
	struct dvsm_scene *scene = make_scene(f, fixed, 0), *other = make_scene(f, wide, 0);

	picture[0] = 7;
	assert_int_equal(dvsm_render(wide, scene, &f->target, 0, picture, NULL, &f->error),
			 DVSM_MISMATCH);
	assert_non_null(strstr(f->error.text, "fixed"));
	assert_int_equal(dvsm_render(fixed, other, &f->target, 0, picture, NULL, &f->error),
			 DVSM_MISMATCH);
	assert_true(picture[0] == 7);
	assert_int_equal(dvsm_scene_copy_cache(scene, 0, picture, picture), DVSM_UNSUPPORTED);
	dvsm_scene_destroy(scene);
	dvsm_scene_destroy(other);
	dvsm_engine_destroy(wide);
	dvsm_engine_destroy(fixed);
}

/* An empty file of its own in the folder for such. */
static void make_file(char *path, size_t size)
{
	const char *folder = getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp";

	snprintf(path, size, "%s/test_forward_fixed.XXXXXX", folder);

	int file = mkstemp(path);

	assert_true(file >= 0);
	close(file);
}

static void a_saved_scene_is_the_same_bits(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, DVSM_PRECISION_FIXED, 1, 0);
	struct dvsm_scene *scene = make_scene(f, engine, 0), *read = NULL;
	struct dvsm_scene_info info;
	char path[512];

	make_file(path, sizeof(path));
	assert_int_equal(dvsm_scene_save(scene, path, &f->error), DVSM_OK);
	assert_int_equal(dvsm_scene_open(path, f->model, &read, &f->error), DVSM_OK);
	assert_int_equal(dvsm_scene_probe(path, &info, &f->error), DVSM_OK);
	unlink(path);
	assert_int_equal(info.precision, DVSM_PRECISION_FIXED);
	assert_int_equal(info.tokens, dvsm_scene_get_token_count(scene));

	struct hashes before = hash_scene(f, engine, scene, 0);
	struct hashes after = hash_scene(f, engine, read, 0);

	assert_string_equal(before.cache, after.cache);
	assert_string_equal(before.picture, after.picture);
	dvsm_scene_destroy(scene);
	dvsm_scene_destroy(read);
	dvsm_engine_destroy(engine);
}

struct quantisation {
	size_t matrices;
	double least_db;
};

static void note_matrix(void *context, const char *tensor, double all_db, double worst_row_db)
{
	struct quantisation *noted = context;

	assert_non_null(strstr(tensor, ".weight"));
	assert_true(worst_row_db <= all_db + 1e-9);
	noted->matrices++;
	noted->least_db = fmin(noted->least_db, worst_row_db);
}

/* Its rows reach 127 where the weights' rows are largest, so quantising them again changes none. */
static void a_quantised_file_gives_the_same_bits(void **state)
{
	struct fixture *f = *state;
	struct dvsm_model *own = f->model, *quantised = NULL;
	struct quantisation first = {0, INFINITY}, again = {0, INFINITY};
	struct hashes before = hash_run(f, 1, 0, 0);
	char path[512];

	make_file(path, sizeof(path));
	assert_int_equal(dvsm_model_quantise(own, path, note_matrix, &first, &f->error), DVSM_OK);
	assert_int_equal(dvsm_model_open(path, &quantised, &f->error), DVSM_OK);
	assert_int_equal(dvsm_model_get_weight_count(quantised), dvsm_model_get_weight_count(own));
	f->model = quantised;

	struct hashes after = hash_run(f, 1, 0, 0);

	f->model = own;
	assert_string_equal(before.cache, after.cache);
	assert_string_equal(before.picture, after.picture);
	/* Even weights up to 127 steps: 10 log10(127^2 / 3 / (1/12)) is 48 dB; rows are short. */
	assert_true(first.matrices == 3 + 8 * odd.layers && first.least_db > 35);
	assert_int_equal(dvsm_model_quantise(quantised, path, note_matrix, &again, &f->error),
			 DVSM_OK);
	assert_true(isinf(again.least_db));
	dvsm_model_close(quantised);
	unlink(path);
}

static struct dvsm_model *quantise_and_open(struct fixture *f)
{
	struct dvsm_model *quantised = NULL;
	char path[512];

	make_file(path, sizeof(path));
	assert_int_equal(dvsm_model_quantise(f->model, path, NULL, NULL, &f->error), DVSM_OK);
	assert_int_equal(dvsm_model_open(path, &quantised, &f->error), DVSM_OK);
	unlink(path);
	return quantised;
}

static enum dvsm_status open_saved(struct fixture *f, const struct dvsm_scene *scene,
				   const struct dvsm_model *model, struct dvsm_scene **read)
{
	char path[512];

	make_file(path, sizeof(path));
	assert_int_equal(dvsm_scene_save(scene, path, &f->error), DVSM_OK);

	enum dvsm_status status = dvsm_scene_open(path, model, read, &f->error);

	unlink(path);
	return status;
}

/* In fixed the bits are the same, so a scene of either opens with the other; in f32 they are not.
 */
static void a_scene_opens_with_the_quantised_file_and_its_source(void **state)
{
	struct fixture *f = *state;
	struct dvsm_model *own = f->model, *quantised = quantise_and_open(f);
	const struct dvsm_model *models[2] = {own, quantised};
	struct hashes hashes[2];

	for (int made = 0; made < 2; made++) {
		f->model = made ? quantised : own;

		struct dvsm_engine *engine = make_engine(f, DVSM_PRECISION_FIXED, 1, 0);
		struct dvsm_scene *scene = make_scene(f, engine, 0), *read = NULL;

		assert_int_equal(open_saved(f, scene, models[!made], &read), DVSM_OK);
		hashes[made] = hash_scene(f, engine, read, 0);
		dvsm_scene_destroy(read);
		dvsm_scene_destroy(scene);
		dvsm_engine_destroy(engine);

		engine = make_engine(f, DVSM_PRECISION_F32, 1, 0);
		scene = make_scene(f, engine, 0);
		assert_int_equal(open_saved(f, scene, models[!made], &read), DVSM_MISMATCH);
		dvsm_scene_destroy(scene);
		dvsm_engine_destroy(engine);
	}
	assert_string_equal(hashes[0].picture, hashes[1].picture);
	f->model = own;
	dvsm_model_close(quantised);
}

/* Its weights are turned; float32 and bfloat16 see them turned back. */
static void a_quantised_file_renders_in_floats(void **state)
{
	static float want[NUMBERS], got[NUMBERS];
	struct fixture *f = *state;
	struct dvsm_model *own = f->model, *quantised = quantise_and_open(f);

	for (enum dvsm_precision p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_BF16; p++) {
		for (int made = 0; made < 2; made++) {
			f->model = made ? quantised : own;

			struct dvsm_engine *engine = make_engine(f, p, 1, 0);
			struct dvsm_scene *scene = make_scene(f, engine, 0);

			assert_int_equal(dvsm_render(engine, scene, &f->target, 0,
						     made ? got : want, NULL, &f->error),
					 DVSM_OK);
			dvsm_scene_destroy(scene);
			dvsm_engine_destroy(engine);
		}
		printf("%s of a quantised file is %.1f dB from that of its source\n",
		       dvsm_precision_name(p), psnr_db(want, got));
		assert_true(psnr_db(want, got) > 40);
	}
	f->model = own;
	dvsm_model_close(quantised);
}

/* Every half block is compared, in one basis: int8 is some 40 dB away, nothing is equal. */
static void layers_are_compared_with_float32(void **state)
{
	struct fixture *f = *state;
	struct dvsm_half_error errors[6];
	struct dvsm_measure_job job = {.model = f->model, .views = f->views, .view_count = VIEWS};
	const size_t halves = 2 * (size_t)odd.layers;

	assert_true(halves == sizeof(errors) / sizeof(errors[0]));
	assert_int_equal(dvsm_activations_measure(&job, errors, &f->error), DVSM_OK);
	assert_true(errors[0].output_db > 30 && isnan(errors[halves - 1].output_db));
	assert_true(errors[halves - 1].keys_db > 25);

	job.targets = &f->target;
	job.target_count = 1;
	assert_int_equal(dvsm_activations_measure(&job, errors, &f->error), DVSM_OK);
	for (size_t i = 0; i < halves; i++) {
		const double figures[5] = {errors[i].keys_db, errors[i].values_db,
					   errors[i].attention_db, errors[i].hidden_db,
					   errors[i].output_db};

		for (size_t n = 0; n < 5; n++)
			assert_true(figures[n] > 25 && figures[n] < 80);
	}
	job.views = NULL;
	assert_int_equal(dvsm_activations_measure(&job, errors, &f->error), DVSM_BAD_ARG);
}

/* Far targets have moments that outgrow 14 bits by far; pictures of nothing have no gradient. */
static void far_targets_and_empty_pictures_are_rendered(void **state)
{
	static uint8_t picture[NUMBERS];
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, DVSM_PRECISION_FIXED, 1, 0);

	memset(f->pictures, 0, sizeof(f->pictures));

	struct dvsm_scene *scene = make_scene(f, engine, 0);
	struct dvsm_camera far = f->target;

	for (double distance = 1; distance < 1e8; distance *= 1000) {
		far.world_from_camera[3] = distance;
		assert_int_equal(dvsm_render_rgb8(engine, scene, &far, 0, picture, NULL, &f->error),
				 DVSM_OK);
	}
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_bits_are_those_written_down),
		TEST(the_number_of_threads_changes_no_bit),
		TEST(order_and_repetition_of_views_change_no_bit),
		TEST(bytes_are_the_floats_rounded),
		TEST(pictures_are_near_float32),
		TEST(the_cache_takes_a_byte_a_number_and_is_planned),
		TEST(a_scene_of_another_precision_is_refused),
		TEST(a_saved_scene_is_the_same_bits),
		TEST(a_quantised_file_gives_the_same_bits),
		TEST(a_scene_opens_with_the_quantised_file_and_its_source),
		TEST(a_quantised_file_renders_in_floats),
		TEST(layers_are_compared_with_float32),
		TEST(far_targets_and_empty_pictures_are_rendered),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
