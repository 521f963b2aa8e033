#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "file_fixture.h"
#include "scene_fixture.h"

/* What each test starts from: a model, its scene, and a place to save it. */
struct house {
	struct dvsm_model *model;
	struct dvsm_scene *scene;
	char folder[256], path[300];
};

static int set_up(void **state)
{
	struct house *house = calloc(1, sizeof(*house));
	assert_non_null(house);
	house->model = scene_fixture_model();
	house->scene = scene_fixture_make(house->model);
	fixture_make_folder(house->folder);
	snprintf(house->path, sizeof(house->path), "%s/s.scene.safetensors", house->folder);
	*state = house;
	return 0;
}

static int tear_down(void **state)
{
	struct house *house = *state;
	dvsm_scene_destroy(house->scene);
	dvsm_model_close(house->model);
	fixture_remove_folder(house->folder);
	free(house);
	return 0;
}

static void assert_saved(const struct house *house)
{
	struct dvsm_error error = {""};
	if (dvsm_scene_save(house->scene, house->path, &error) != DVSM_OK)
		fail_msg("%s", error.text);
}

/* Open from a copy of exactly this size, so that a sanitizer sees a read beyond the end. */
static enum dvsm_status open_copy(const unsigned char *bytes, size_t size,
				  const struct dvsm_model *model, struct dvsm_error *error)
{
	unsigned char *copy = malloc(size ? size : 1);
	struct dvsm_scene *scene = NULL;
	assert_non_null(copy);
	memcpy(copy, bytes, size);
	enum dvsm_status status =
		dvsm_scene_open_bytes(copy, size, "s.safetensors", model, &scene, error);
	assert_true((status == DVSM_OK) == (scene != NULL));
	dvsm_scene_destroy(scene);
	free(copy);
	return status;
}

static void a_scene_comes_back_bit_by_bit(void **state)
{
	struct house *house = *state;
	const struct dvsm_scene *made = house->scene;
	struct dvsm_scene *read = NULL;
	struct dvsm_error error = {""};
	assert_saved(house);
	if (dvsm_scene_open(house->path, house->model, &read, &error) != DVSM_OK)
		fail_msg("%s", error.text);
	assert_int_equal(dvsm_scene_get_view_count(read), made->views);
	assert_int_equal(dvsm_scene_get_token_count(read), made->tokens);
	assert_int_equal(dvsm_scene_get_patch_px(read), 16);
	assert_int_equal(dvsm_scene_get_cache_bytes(read), made->cache_bytes);
	assert_string_equal(dvsm_scene_get_model_sha256(read), made->model_sha256);
	assert_memory_equal(dvsm_scene_get_cameras(read), made->cameras,
			    made->views * sizeof(*made->cameras));
	assert_memory_equal(&read->normalisation, &made->normalisation,
			    sizeof(made->normalisation));
	assert_memory_equal(read->first_token, made->first_token,
			    (made->views + 1) * sizeof(*made->first_token));

	size_t count = made->tokens * made->dim;
	float *caches = calloc(4 * count, sizeof(*caches));
	assert_non_null(caches);
	for (uint32_t layer = 0; layer < made->layers; layer++) {
		assert_int_equal(dvsm_scene_copy_cache(made, layer, caches, caches + count),
				 DVSM_OK);
		assert_int_equal(
			dvsm_scene_copy_cache(read, layer, caches + 2 * count, caches + 3 * count),
			DVSM_OK);
		assert_memory_equal(caches, caches + 2 * count, 2 * count * sizeof(*caches));
	}
	assert_int_equal(dvsm_scene_copy_cache(read, made->layers, caches, caches + count),
			 DVSM_BAD_ARG);
	free(caches);
	dvsm_scene_destroy(read);
}

static void a_probe_tells_what_the_file_holds(void **state)
{
	struct house *house = *state;
	struct dvsm_scene_info info;
	assert_saved(house);
	assert_int_equal(dvsm_scene_probe(house->path, &info, NULL), DVSM_OK);
	assert_int_equal(info.views, 3);
	assert_int_equal(info.layers, 1);
	assert_int_equal(info.heads, 2);
	assert_int_equal(info.dim, 8);
	assert_int_equal(info.patch_px, 16);
	/* 48 x 32, 35 x 32 and 48 x 61 at patch 16. */
	assert_int_equal(info.tokens, 3 * 2 + 2 * 2 + 3 * 4);
	assert_int_equal(info.cache_bytes, house->scene->cache_bytes);
	assert_string_equal(info.model_sha256, dvsm_model_get_sha256(house->model));
}

static void another_models_scene_is_refused_and_both_hashes_told(void **state)
{
	struct house *house = *state;
	char made_with[65];
	struct dvsm_scene *scene = NULL;
	struct dvsm_error error = {""};
	house->scene->model_sha256[0] = house->scene->model_sha256[0] == 'f' ? '0' : 'f';
	strcpy(made_with, house->scene->model_sha256);
	assert_saved(house);
	assert_int_equal(dvsm_scene_open(house->path, house->model, &scene, &error), DVSM_MISMATCH);
	assert_null(scene);
	assert_text_has(&error, made_with);
	assert_text_has(&error, dvsm_model_get_sha256(house->model));
	/* Without a model there is nothing to disagree with. */
	struct dvsm_scene_info info;
	assert_int_equal(dvsm_scene_probe(house->path, &info, NULL), DVSM_OK);
}

static void a_scene_cut_anywhere_is_refused(void **state)
{
	struct house *house = *state;
	size_t size;
	assert_saved(house);
	unsigned char *bytes = scene_fixture_read(house->path, &size);
	assert_int_equal(open_copy(bytes, size, house->model, NULL), DVSM_OK);
	for (size_t cut = 0; cut < size; cut++) {
		struct dvsm_error error = {""};
		assert_int_equal(open_copy(bytes, cut, house->model, &error), DVSM_BAD_FILE);
		assert_text_has(&error, "s.safetensors: ");
	}
	free(bytes);
}

static void any_flipped_bit_is_noticed(void **state)
{
	struct house *house = *state;
	size_t size;
	assert_saved(house);
	unsigned char *bytes = scene_fixture_read(house->path, &size);
	uint64_t header_bits = 0;
	memcpy(&header_bits, bytes, 8);
	header_bits = 8 * (header_bits + 8);
	/* Every bit of the header, and of the tensors one in 61, which meets every bit of a byte.
	 */
	for (size_t bit = 0; bit < 8 * size; bit += bit < header_bits ? 1 : 61) {
		struct dvsm_error error = {""};
		bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
		enum dvsm_status status = open_copy(bytes, size, house->model, &error);
		bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
		if (status == DVSM_OK)
			fail_msg("bit %zu of %zu flipped and not noticed", bit, 8 * size);
		assert_text_has(&error, "s.safetensors: ");
	}
	free(bytes);
}

/* Save the scene as it now is, with a checksum that fits, and open it. */
static void assert_scene_refused(struct house *house, const char *needle)
{
	struct dvsm_scene *scene = NULL;
	struct dvsm_scene_info info;
	struct dvsm_error error = {""};
	assert_saved(house);
	assert_int_equal(dvsm_scene_open(house->path, house->model, &scene, &error), DVSM_BAD_FILE);
	assert_null(scene);
	assert_text_has(&error, needle);
	assert_int_equal(dvsm_scene_probe(house->path, &info, &error), DVSM_BAD_FILE);
}

static void a_non_finite_number_is_refused_though_the_checksum_fits(void **state)
{
	struct house *house = *state;
	struct dvsm_scene *scene = house->scene;
	float *keys = scene->keys, *values = scene->values, kept = keys[17];
	keys[17] = NAN;
	assert_scene_refused(house, "tensor keys: number 17 is not finite");
	keys[17] = kept;
	values[0] = -INFINITY;
	assert_scene_refused(house, "tensor values: number 0 is not finite");
	values[0] = 0;
	scene->cameras[1].world_from_camera[3] = NAN;
	assert_scene_refused(house, "tensor cameras: number 31 is not finite");
	scene->cameras[1].world_from_camera[3] = 0;
	scene->normalisation.scale = INFINITY;
	assert_scene_refused(house, "tensor normalisation: number 12 is not finite");
}

static void numbers_that_would_overflow_a_picture_are_refused_though_the_checksum_fits(void **state)
{
	struct house *house = *state;
	float *numbers[] = {house->scene->keys, house->scene->values};
	for (size_t i = 0; i < 2; i++) {
		float before = numbers[i][5];
		struct dvsm_scene *scene = NULL;
		struct dvsm_error error = {""};
		numbers[i][5] = -1e30f;
		assert_saved(house);
		assert_int_equal(dvsm_scene_open(house->path, house->model, &scene, &error),
				 DVSM_BAD_FILE);
		assert_null(scene);
		assert_text_has(&error, "range of float32");
		numbers[i][5] = before;
	}
}

static void cameras_out_of_range_are_refused_though_the_checksum_fits(void **state)
{
	struct house *house = *state;
	struct dvsm_camera *camera = &house->scene->cameras[2];
	const struct dvsm_camera good = *camera;
	camera->fx = 0;
	assert_scene_refused(house, "tensor cameras: view 2: focal length");
	*camera = good;
	camera->world_from_camera[0] = 2;
	assert_scene_refused(house, "tensor cameras: view 2: the rotation");
	*camera = good;
	camera->width = 0;
	assert_scene_refused(house, "tensor cameras: view 2: picture size");
	*camera = good;
	camera->width = 16385;
	assert_scene_refused(house, "tensor cameras: view 2: picture size");
}

static void parts_that_do_not_belong_together_are_refused(void **state)
{
	struct house *house = *state;
	struct dvsm_scene *scene = house->scene;
	scene->patch_px = 8;
	assert_scene_refused(house, "tensor keys: holds 22 tokens, the cameras make 88");
	scene->patch_px = 0;
	assert_scene_refused(house, "patch is 0");
	scene->patch_px = 16;
	scene->normalisation.scale *= 1.001;
	assert_scene_refused(house, "tensor normalisation: does not belong");
	scene->normalisation = dvsm_normalisation_compute(scene->cameras, scene->views);
	scene->normalisation.origin[1] += 0.01;
	assert_scene_refused(house, "tensor normalisation: does not belong");
	scene->normalisation = dvsm_normalisation_compute(scene->cameras, scene->views);
	scene->views = 2;
	assert_scene_refused(house, "tensor keys: holds 22 tokens");
}

static void a_scene_of_other_sizes_than_its_model_is_refused(void **state)
{
	struct house *house = *state;
	struct dvsm_scene *scene = NULL;
	struct dvsm_error error = {""};
	house->scene->heads = 4;
	assert_saved(house);
	assert_int_equal(dvsm_scene_open(house->path, house->model, &scene, &error), DVSM_BAD_FILE);
	assert_text_has(&error, "dim, heads and layers are not the model's");
}

/* Replace a text of the header by one of the same length. */
static void with_header(struct house *house, const char *from, const char *to,
			enum dvsm_status status, const char *needle)
{
	size_t size;
	struct dvsm_error error = {""};
	assert_saved(house);
	assert_int_equal(strlen(from), strlen(to));
	unsigned char *bytes = scene_fixture_read(house->path, &size);
	unsigned char *at = memmem(bytes, size, from, strlen(from));
	assert_non_null(at);
	memcpy(at, to, strlen(to));
	assert_int_equal(open_copy(bytes, size, house->model, &error), status);
	assert_text_has(&error, needle);
	free(bytes);
}

static void a_header_that_lacks_something_is_refused(void **state)
{
	struct house *house = *state;
	with_header(house, "\"cameras\"", "\"comeras\"", DVSM_BAD_FILE, "cameras: is missing");
	with_header(house, "\"keys\"", "\"kegs\"", DVSM_BAD_FILE, "keys: is missing");
	with_header(house, "\"values\"", "\"volues\"", DVSM_BAD_FILE, "values: is missing");
	with_header(house, "\"normalisation\"", "\"normalization\"", DVSM_BAD_FILE,
		    "normalisation: is missing");
	with_header(house, "\"F32\"", "\"I32\"", DVSM_BAD_FILE, "keys: is I32, must be F32");
	with_header(house, "\"F64\"", "\"I64\"", DVSM_BAD_FILE, "cameras: is I64, must be F64");
	with_header(house, "[3,22]", "[22,3]", DVSM_BAD_FILE, "must be [22, 22]");
	with_header(house, "[1,2,22,4]", "[2,1,22,4]", DVSM_BAD_FILE, "must be [1, 2, 22, 4]");
	with_header(house, "\"dvsm-scene\"", "\"dvsm-scone\"", DVSM_BAD_FILE, "is no scene");
	with_header(house, "\"version\":\"1\"", "\"version\":\"9\"", DVSM_UNSUPPORTED,
		    "scene version 9");
	with_header(house, "\"config\"", "\"konfig\"", DVSM_BAD_FILE, "has no config");
	with_header(house, "\"model_sha256\"", "\"model_sha512\"", DVSM_BAD_FILE,
		    "model_sha256 is not 64");
	with_header(house, "\"sha256\"", "\"sha512\"", DVSM_BAD_FILE, "sha256 is not 64");
}

static void a_model_is_no_scene_and_a_scene_is_no_model(void **state)
{
	struct house *house = *state;
	struct fixture_file file;
	struct dvsm_error error = {""};
	size_t size;
	fixture_init_model(&file, "F32");
	unsigned char *bytes = fixture_emit(&file, &size);
	assert_int_equal(open_copy(bytes, size, house->model, &error), DVSM_BAD_FILE);
	assert_text_has(&error, "is no scene");
	free(bytes);
	fixture_deinit(&file);

	struct dvsm_model *model = NULL;
	assert_saved(house);
	assert_int_equal(dvsm_model_open(house->path, &model, &error), DVSM_BAD_FILE);
	assert_text_has(&error, "is no model");
}

static void sizes_beyond_memory_are_refused_and_not_wrapped(void **state)
{
	(void)state;
	const struct dvsm_model_config config = {.dim = 16384, .heads = 1, .layers = 1024};
	struct dvsm_camera *cameras = calloc(DVSM_MAX_VIEWS, sizeof(*cameras));
	assert_non_null(cameras);
	for (uint32_t i = 0; i < DVSM_MAX_VIEWS; i++)
		cameras[i].width = cameras[i].height = DVSM_MAX_SIDE_PX;
	size_t tokens = 7, bytes = 7;
	struct dvsm_error error = {""};
	assert_int_equal(dvsm_scene_measure(&config, DVSM_PRECISION_F32, cameras, DVSM_MAX_VIEWS, 1,
					    &tokens, &bytes, &error),
			 DVSM_NO_MEM);
	assert_text_has(&error, "KV-cache");
	assert_int_equal(tokens, 7);
	assert_int_equal(bytes, 7);
	free(cameras);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(a_scene_comes_back_bit_by_bit, set_up, tear_down),
		cmocka_unit_test_setup_teardown(a_probe_tells_what_the_file_holds, set_up,
						tear_down),
		cmocka_unit_test_setup_teardown(
			another_models_scene_is_refused_and_both_hashes_told, set_up, tear_down),
		cmocka_unit_test_setup_teardown(a_scene_cut_anywhere_is_refused, set_up, tear_down),
		cmocka_unit_test_setup_teardown(any_flipped_bit_is_noticed, set_up, tear_down),
		cmocka_unit_test_setup_teardown(
			a_non_finite_number_is_refused_though_the_checksum_fits, set_up, tear_down),
		cmocka_unit_test_setup_teardown(
			numbers_that_would_overflow_a_picture_are_refused_though_the_checksum_fits,
			set_up, tear_down),
		cmocka_unit_test_setup_teardown(
			cameras_out_of_range_are_refused_though_the_checksum_fits, set_up,
			tear_down),
		cmocka_unit_test_setup_teardown(parts_that_do_not_belong_together_are_refused,
						set_up, tear_down),
		cmocka_unit_test_setup_teardown(a_scene_of_other_sizes_than_its_model_is_refused,
						set_up, tear_down),
		cmocka_unit_test_setup_teardown(a_header_that_lacks_something_is_refused, set_up,
						tear_down),
		cmocka_unit_test_setup_teardown(a_model_is_no_scene_and_a_scene_is_no_model, set_up,
						tear_down),
		cmocka_unit_test_setup_teardown(sizes_beyond_memory_are_refused_and_not_wrapped,
						set_up, tear_down),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
