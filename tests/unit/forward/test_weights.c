/* Weight sets: who shares them, what a model opened for one precision keeps, and that bits agree.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/safetensors.h"
#include "model/model.h"
#include "support/random_model.h"

enum { VIEWS = 2, SIDE = 48, NUMBERS = SIDE * SIDE * 3 };

struct fixture {
	struct dvsm_model_config config;
	char path[512]; /* of the model's file */
	struct dvsm_view views[VIEWS];
	struct dvsm_camera target;
	float pictures[VIEWS][NUMBERS];
	struct dvsm_error error;
};

static void make_path(char *path, size_t size)
{
	const char *folder = getenv("TMPDIR");
	int file;

	snprintf(path, size, "%s/dvsm-weights-XXXXXX", folder ? folder : "/tmp");
	file = mkstemp(path);
	assert_true(file >= 0);
	close(file);
}

static void write_file(const char *path, const unsigned char *bytes, size_t size)
{
	FILE *file = fopen(path, "wb");

	assert_non_null(file);
	assert_int_equal(fwrite(bytes, 1, size, file), size);
	assert_int_equal(fclose(file), 0);
}

static int set_up(void **state)
{
	/* Wide enough for the padding of panels to count for little. */
	static const struct dvsm_model_config config = {
		.dim = 128,
		.heads = 2,
		.layers = 2,
		.patch_px = 8,
		.mlp_ratio = 4,
		.norm_eps = 1e-6,
	};
	struct fixture *f = calloc(1, sizeof(*f));
	struct support_random random = support_random_seeded("test_weights");
	unsigned char *bytes;
	size_t size;

	assert_non_null(f);
	f->config = config;
	bytes = support_random_model_file(&config, &random, &size);
	assert_non_null(bytes);
	make_path(f->path, sizeof(f->path));
	write_file(f->path, bytes, size);
	free(bytes);
	for (uint32_t v = 0; v < VIEWS; v++) {
		const struct dvsm_camera camera = support_ring_camera(SIDE, SIDE, v, 12);

		f->views[v] = support_random_view(&random, &camera, f->pictures[v]);
	}
	f->target = support_ring_camera(SIDE, SIDE, 3, 12);
	*state = f;
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *f = *state;

	unlink(f->path);
	free(f);
	return 0;
}

static struct dvsm_model *open_all(struct fixture *f)
{
	struct dvsm_model *model = NULL;

	if (dvsm_model_open(f->path, &model, &f->error) != DVSM_OK)
		fail_msg("%s", f->error.text);
	return model;
}

static struct dvsm_model *open_for(struct fixture *f, enum dvsm_precision precision)
{
	struct dvsm_model *model = NULL;

	if (dvsm_model_open_for(f->path, precision, &model, &f->error) != DVSM_OK)
		fail_msg("%s", f->error.text);
	return model;
}

static struct dvsm_engine *make_engine(struct fixture *f, const struct dvsm_model *model,
				       enum dvsm_precision precision)
{
	const struct dvsm_engine_options options = {.threads = 2, .precision = precision};
	struct dvsm_engine *engine = NULL;

	if (dvsm_engine_create(model, &options, &engine, &f->error) != DVSM_OK)
		fail_msg("%s", f->error.text);
	return engine;
}

/* Of the cache and of a picture. */
struct hashes {
	char cache[65], picture[65];
};

static struct hashes hash_run(struct fixture *f, const struct dvsm_model *model,
			      enum dvsm_precision precision)
{
	struct dvsm_engine *engine = make_engine(f, model, precision);
	float *picture = malloc(NUMBERS * sizeof(*picture));
	struct dvsm_scene *scene = NULL;
	struct hashes hashes;

	assert_non_null(picture);
	assert_int_equal(
		dvsm_reconstruct(engine, f->views, VIEWS, 0, NULL, NULL, &scene, NULL, &f->error),
		DVSM_OK);
	assert_int_equal(dvsm_render(engine, scene, &f->target, 0, picture, NULL, &f->error),
			 DVSM_OK);
	dvsm_scene_hash_cache(scene, hashes.cache);
	dvsm_hash_bytes(picture, NUMBERS * sizeof(*picture), hashes.picture);
	free(picture);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
	return hashes;
}

static void expect_the_same_bits(struct fixture *f)
{
	struct dvsm_model *all = open_all(f);

	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++) {
		struct dvsm_model *one = open_for(f, (enum dvsm_precision)p);
		struct hashes want = hash_run(f, all, (enum dvsm_precision)p);
		struct hashes got = hash_run(f, one, (enum dvsm_precision)p);

		assert_string_equal(dvsm_model_get_sha256(one), dvsm_model_get_sha256(all));
		assert_string_equal(got.cache, want.cache);
		assert_string_equal(got.picture, want.picture);
		dvsm_model_close(one);
	}
	dvsm_model_close(all);
}

static void a_model_of_one_precision_gives_the_bits_of_one_for_all(void **state)
{
	expect_the_same_bits(*state);
}

static void so_does_a_quantised_one(void **state)
{
	struct fixture *f = *state;
	struct dvsm_model *all = open_all(f);
	enum dvsm_status status = dvsm_model_quantise(all, f->path, NULL, NULL, &f->error);

	assert_int_equal(status, DVSM_OK);
	dvsm_model_close(all);
	expect_the_same_bits(f);
}

static void it_keeps_the_weights_of_its_precision_alone(void **state)
{
	struct fixture *f = *state;
	/* Bytes of a weight, and what scales, sums and the first block's finer products add. */
	static const double most[] = {4 * 1.01, 2 * 1.02, 1 * 1.6};

	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++) {
		struct dvsm_model *model = open_for(f, (enum dvsm_precision)p);
		double weights = (double)dvsm_model_get_weight_count(model);
		size_t bytes = dvsm_model_get_weight_bytes(model);
		struct dvsm_engine *engine = make_engine(f, model, (enum dvsm_precision)p);

		assert_true((double)bytes < most[p] * weights);
		assert_true((double)bytes > 0.75 * most[p] * weights);
		/* Engines add nothing, and take nothing with them. */
		assert_int_equal(dvsm_model_get_weight_bytes(model), bytes);
		dvsm_engine_destroy(engine);
		assert_int_equal(dvsm_model_get_weight_bytes(model), bytes);
		dvsm_model_close(model);
	}
}

static void it_refuses_what_needs_other_weights(void **state)
{
	struct fixture *f = *state;
	struct dvsm_model *model = open_for(f, DVSM_PRECISION_BF16);
	const struct dvsm_engine_options options = {.precision = DVSM_PRECISION_FIXED};
	struct dvsm_engine *engine = NULL;
	char path[512];

	assert_int_equal(dvsm_engine_create(model, &options, &engine, &f->error), DVSM_UNSUPPORTED);
	assert_null(engine);
	assert_non_null(strstr(f->error.text, "opened for engines in bf16, not fixed"));
	make_path(path, sizeof(path));
	assert_int_equal(dvsm_model_quantise(model, path, NULL, NULL, &f->error), DVSM_UNSUPPORTED);
	assert_non_null(strstr(f->error.text, "open it for all"));
	unlink(path);
	dvsm_model_close(model);
	model = NULL;
	assert_int_equal(dvsm_model_open_for(f->path, (enum dvsm_precision)7, &model, &f->error),
			 DVSM_UNSUPPORTED);
	assert_null(model);
}

static void engines_of_one_precision_share_a_set_that_goes_with_the_last(void **state)
{
	struct fixture *f = *state;
	struct dvsm_model *model = open_all(f);
	const size_t own = dvsm_model_get_weight_bytes(model);

	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++) {
		struct dvsm_engine *first = make_engine(f, model, (enum dvsm_precision)p);
		const size_t with_one = dvsm_model_get_weight_bytes(model);
		struct dvsm_engine *second = make_engine(f, model, (enum dvsm_precision)p);

		assert_true(p == DVSM_PRECISION_F32 ? with_one == own : with_one > own);
		assert_int_equal(dvsm_model_get_weight_bytes(model), with_one);
		dvsm_engine_destroy(first);
		assert_int_equal(dvsm_model_get_weight_bytes(model), with_one);
		dvsm_engine_destroy(second);
		assert_int_equal(dvsm_model_get_weight_bytes(model), own);
	}
	dvsm_model_close(model);
}

static void ignore(void *context, size_t first, const float *numbers, size_t count)
{
	(void)context;
	(void)first;
	(void)numbers;
	(void)count;
}

static void a_file_that_was_written_to_is_not_read_again(void **state)
{
	struct fixture *f = *state;
	const struct timespec long_ago[2] = {{.tv_sec = 1}, {.tv_sec = 1}};
	struct dvsm_safetensors file;
	char hex[DVSM_SHA256_HEX];

	assert_int_equal(dvsm_safetensors_open(f->path, &file, &f->error), DVSM_OK);
	assert_int_equal(dvsm_safetensors_load(&file, NULL, hex, &f->error), DVSM_OK);
	assert_int_equal(
		dvsm_safetensors_read_part(&file, &file.tensors[0], 1, 3, ignore, NULL, &f->error),
		DVSM_OK);
	/* As a writer leaves it, whatever the resolution of the system's clock. */
	assert_int_equal(utimensat(AT_FDCWD, f->path, long_ago, 0), 0);
	assert_int_equal(
		dvsm_safetensors_read_part(&file, &file.tensors[0], 1, 3, ignore, NULL, &f->error),
		DVSM_IO);
	assert_non_null(strstr(f->error.text, "changed while being read"));
	dvsm_safetensors_close(&file);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
	const struct CMUnitTest tests[] = {
		TEST(a_model_of_one_precision_gives_the_bits_of_one_for_all),
		TEST(so_does_a_quantised_one),
		TEST(it_keeps_the_weights_of_its_precision_alone),
		TEST(it_refuses_what_needs_other_weights),
		TEST(engines_of_one_precision_share_a_set_that_goes_with_the_last),
		TEST(a_file_that_was_written_to_is_not_read_again),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
