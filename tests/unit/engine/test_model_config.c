#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "file_fixture.h"
#include "model/model.h"

/* A config with `from` replaced by `to`; empty `from` appends to the front of the object. */
static void with_config(const char *from, const char *to, enum dvsm_status status,
			const char *needle)
{
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	char old[512];
	strcpy(old, file.config);
	char *at = strstr(old, from);
	assert_non_null(at);
	snprintf(file.config, sizeof(file.config), "%.*s%s%s", (int)(at - old), old, to,
		 at + strlen(from));
	assert_model_refused(&file, status, "m.safetensors: ", needle);
	fixture_deinit(&file);
}

static void a_missing_key_is_named(void **state)
{
	(void)state;
	with_config("\"dim\": 8, ", "", DVSM_BAD_FILE, "dim is missing");
	with_config("\"heads\": 2, ", "", DVSM_BAD_FILE, "heads is missing");
	with_config("\"layers\": 1, ", "", DVSM_BAD_FILE, "layers is missing");
	with_config("\"patch\": 2, ", "", DVSM_BAD_FILE, "patch is missing");
	with_config("\"mlp_ratio\": 2, ", "", DVSM_BAD_FILE, "mlp_ratio is missing");
	with_config("\"norm_eps\": 1e-06, ", "", DVSM_BAD_FILE, "norm_eps is missing");
	with_config("\"pose_norm\": \"gs-lrm\", ", "", DVSM_BAD_FILE, "pose_norm is missing");
	with_config(", \"prior\": null", "", DVSM_BAD_FILE, "prior is missing");
}

static void a_wrong_type_is_named(void **state)
{
	(void)state;
	with_config("\"dim\": 8", "\"dim\": \"8\"", DVSM_BAD_FILE, "dim is not a whole number");
	with_config("\"dim\": 8", "\"dim\": 8.0", DVSM_BAD_FILE, "dim is not a whole number");
	with_config("\"heads\": 2", "\"heads\": -2", DVSM_BAD_FILE, "heads is not a whole");
	with_config("\"layers\": 1", "\"layers\": [1]", DVSM_BAD_FILE, "layers is not a whole");
	with_config("\"patch\": 2", "\"patch\": null", DVSM_BAD_FILE, "patch is not a whole");
	with_config("1e-06", "\"1e-06\"", DVSM_BAD_FILE, "norm_eps is not a number");
	with_config("\"linear\"", "1", DVSM_BAD_FILE, "rgb_out is not a text");
	with_config("\"gs-lrm\"", "true", DVSM_BAD_FILE, "pose_norm is not a text");
	with_config("null", "7", DVSM_BAD_FILE, "prior is neither null nor an object");
	with_config("null", "{}", DVSM_BAD_FILE, "dim is missing");
}

static void an_absurd_size_is_refused_before_anything_is_allocated(void **state)
{
	(void)state;
	with_config("\"dim\": 8", "\"dim\": 0", DVSM_BAD_FILE, "dim is 0");
	with_config("\"dim\": 8", "\"dim\": 4294967296", DVSM_BAD_FILE, "dim is 4294967296");
	with_config("\"dim\": 8", "\"dim\": 99999999999999999999", DVSM_BAD_FILE,
		    "dim is not a whole number");
	with_config("\"heads\": 2", "\"heads\": 0", DVSM_BAD_FILE, "heads is 0");
	with_config("\"heads\": 2", "\"heads\": 3", DVSM_BAD_FILE, "not a multiple of heads 3");
	with_config("\"layers\": 1", "\"layers\": 1000000", DVSM_BAD_FILE, "layers is 1000000");
	with_config("\"patch\": 2", "\"patch\": 257", DVSM_BAD_FILE, "patch is 257");
	with_config("\"mlp_ratio\": 2", "\"mlp_ratio\": 65", DVSM_BAD_FILE, "mlp_ratio is 65");
	with_config("1e-06", "0", DVSM_BAD_FILE, "norm_eps is 0");
	with_config("1e-06", "-1e-06", DVSM_BAD_FILE, "norm_eps is -1e-06");
	with_config("1e-06", "1", DVSM_BAD_FILE, "norm_eps is 1");
	with_config("1e-06", "1e-300", DVSM_BAD_FILE, "norm_eps is 1e-300");
}

static void what_this_build_does_not_know_is_unsupported(void **state)
{
	(void)state;
	with_config("\"linear\"", "\"relu\"", DVSM_UNSUPPORTED, "rgb_out \"relu\"");
	with_config("\"gs-lrm\"", "\"none\"", DVSM_UNSUPPORTED, "pose_norm \"none\"");
	with_config("{", "{\"quant\": {\"bits\": 8}, ", DVSM_UNSUPPORTED, "quant is not known");
}

static void text_that_is_no_config_is_refused(void **state)
{
	(void)state;
	with_config("{", "", DVSM_BAD_FILE, "config is not JSON");
	with_config("}", "", DVSM_BAD_FILE, "config is not JSON");
	with_config("{", "{\"dim\": 8, ", DVSM_BAD_FILE, "a key twice");
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	strcpy(file.config, "[]");
	assert_model_refused(&file, DVSM_BAD_FILE, "config", "not an object");
	fixture_deinit(&file);
}

static void the_config_is_read_as_written(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	char *linear = strstr(file.config, "\"linear\"");
	char rest[200];
	strcpy(rest, linear + strlen("\"linear\""));
	sprintf(linear, "\"sigmoid\"%s", rest);
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	struct dvsm_model *model;
	assert_int_equal(fixture_open_model(bytes, size, &model, NULL), DVSM_OK);
	const struct dvsm_model_config *config = dvsm_model_get_config(model);
	assert_int_equal(config->dim, 8);
	assert_int_equal(config->heads, 2);
	assert_int_equal(config->layers, 1);
	assert_int_equal(config->patch_px, 2);
	assert_int_equal(config->mlp_ratio, 2);
	assert_int_equal(config->prior_dim, 0);
	assert_true(config->norm_eps == 1e-06);
	assert_true(config->rgb_sigmoid);
	dvsm_model_close(model);
	free(bytes);
	fixture_deinit(&file);
}

static void a_prior_brings_its_projection(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	strcpy(strstr(file.config, "null"), "{\"name\": \"dinov3\", \"dim\": 5}}");
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor prior_proj.weight", "is missing");
	fixture_append(&file, "prior_proj.weight", "F32", "[8, 5]", 160);
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	struct dvsm_model *model;
	assert_int_equal(fixture_open_model(bytes, size, &model, NULL), DVSM_OK);
	assert_int_equal(dvsm_model_get_config(model)->prior_dim, 5);
	assert_non_null(model->weights.prior_proj.panels);
	dvsm_model_close(model);
	free(bytes);
	fixture_deinit(&file);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_missing_key_is_named),
		cmocka_unit_test(a_wrong_type_is_named),
		cmocka_unit_test(an_absurd_size_is_refused_before_anything_is_allocated),
		cmocka_unit_test(what_this_build_does_not_know_is_unsupported),
		cmocka_unit_test(text_that_is_no_config_is_refused),
		cmocka_unit_test(the_config_is_read_as_written),
		cmocka_unit_test(a_prior_brings_its_projection),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
