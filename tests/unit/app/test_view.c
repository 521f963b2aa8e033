/* Views: loading, undistortion, names, the nearest view, and which patch suits a picture. */
#include "unit/app/fixture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/model_choice.h"
#include "core/view.h"

static const struct dio_pose HERE = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}};

static void append(struct dio_scene_file *scene, const char *file, enum dio_scene_role role,
		   const struct dio_camera_model *camera, const struct dio_pose *pose)
{
	assert_int_equal(dio_scene_file_append(scene, file, role, camera, pose, NULL), DIO_OK);
}

static void a_distorted_camera_becomes_a_pinhole_of_the_same_size(void **state)
{
	const struct dio_camera_model bent = {64, 48, 60, 60, 31.5, 23.5, {-0.3, 0.1, 0, 0, 0}};
	const struct dio_camera_model straight = {64, 48, 60, 60, 30, 20, {0}};
	struct dio_scene_file scene = {.name = strdup("s"), .folder = strdup(fixture_path("lens"))};
	struct dio_view_set set = {0};
	struct dio_error error = {0};

	(void)state;
	fixture_write_picture("lens/a.png", 64, 48);
	append(&scene, "a.png", DIO_ROLE_CONTEXT, &bent, &HERE);
	append(&scene, "a.png", DIO_ROLE_CONTEXT, &straight, &HERE);
	append(&scene, NULL, DIO_ROLE_TARGET, &bent, &HERE);
	if (dio_view_set_load(&scene, DIO_LOAD_ALL, &set, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_int_equal(set.context[0].camera.width, 64);
	assert_int_equal(set.context[0].picture.width, 64);
	assert_float_equal(set.context[0].camera.fx, set.context[0].camera.fy, 1e-12);
	assert_float_equal(set.context[0].camera.cx, 31.5, 1e-9);
	for (int i = 0; i < 5; i++)
		assert_float_equal(set.context[0].camera.dist[i], 0, 0);
	/* A straight one stays as it is, principal point and all; a target shares its lens. */
	assert_memory_equal(&set.context[1].camera, &straight, sizeof straight);
	assert_memory_equal(&set.target[0].camera, &set.context[0].camera, sizeof straight);
	assert_null(set.target[0].picture.rgb);
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&scene);
}

static void views_of_one_name_stay_apart(void **state)
{
	const struct dio_camera_model camera = {8, 8, 9, 9, 3.5, 3.5, {0}};
	struct dio_scene_file scene = {.name = strdup("s"), .folder = strdup(".")};
	struct dio_view_set set = {0};

	(void)state;
	append(&scene, "left/000.png", DIO_ROLE_TARGET, &camera, &HERE);
	append(&scene, "right/000.jpg", DIO_ROLE_TARGET, &camera, &HERE);
	append(&scene, NULL, DIO_ROLE_TARGET, &camera, &HERE);
	append(&scene, "a.b.png", DIO_ROLE_TARGET, &camera, &HERE);
	assert_int_equal(dio_view_set_load(&scene, 0, &set, NULL), DIO_OK);
	assert_string_equal(set.target[0].name, "000");
	assert_string_equal(set.target[1].name, "000_1");
	assert_string_equal(set.target[2].name, "target_002");
	assert_string_equal(set.target[3].name, "a.b");
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&scene);
}

static void the_nearest_view_counts_distance_and_angle(void **state)
{
	struct dio_view views[3] = {{.pose = HERE}, {.pose = HERE}, {.pose = HERE}};
	const struct dio_view_set set = {.context = views, .context_count = 3};

	(void)state;
	views[0].pose.world_from_camera[3] = 3;
	views[1].pose.world_from_camera[3] = 1;
	views[2].pose.world_from_camera[3] = 2;
	assert_int_equal(dio_view_nearest(&set, &HERE), 1);
	/* Turned away by 90 degrees about y it is 1.57 worse; the mean distance is 2. */
	views[1].pose.world_from_camera[0] = views[1].pose.world_from_camera[10] = 0;
	views[1].pose.world_from_camera[2] = 1;
	views[1].pose.world_from_camera[8] = -1;
	assert_int_equal(dio_view_nearest(&set, &HERE), 2);
	/* The first of equals. */
	views[0].pose.world_from_camera[3] = -2;
	assert_int_equal(dio_view_nearest(&set, &HERE), 0);
}

static void the_patch_follows_the_tokens_of_the_training(void **state)
{
	(void)state;
	assert_int_equal(dio_model_choose_patch(64, 8, 64, 64), 8);
	assert_int_equal(dio_model_choose_patch(64, 8, 256, 256), 32);
	assert_int_equal(dio_model_choose_patch(256, 8, 256, 256), 16);
	assert_int_equal(dio_model_choose_patch(1024, 8, 256, 256), 8);
	assert_int_equal(dio_model_choose_patch(64, 8, 1920, 1080), 180);
	assert_int_equal(dio_model_choose_patch(64, 8, 1, 1), 1);
	assert_int_equal(dio_model_choose_patch(0, 16, 1920, 1080), 16);
}

static enum dio_status read_card(const char *text, struct dio_model_card *card,
				 struct dio_error *error)
{
	if (text)
		fixture_write("m.json", text);
	return dio_model_read_card(fixture_path("m.safetensors"), card, error);
}

static void a_card_states_what_weights_need_and_a_bad_one_is_refused(void **state)
{
	struct dio_model_card card = {.tokens_per_view = 7, .deblock = true};
	struct dio_error error = {0};

	(void)state;
	assert_int_equal(read_card(NULL, &card, &error), DIO_OK);
	assert_int_equal(card.tokens_per_view, 0);
	assert_false(card.deblock);
	assert_int_equal(read_card("{\"tokens_per_view\": 256}", &card, &error), DIO_OK);
	assert_int_equal(card.tokens_per_view, 256);
	assert_false(card.deblock);
	assert_int_equal(read_card("{\"deblock\": true}", &card, &error), DIO_OK);
	assert_int_equal(card.tokens_per_view, 0);
	assert_true(card.deblock);
	assert_int_equal(read_card("{\"deblock\": \"yes\"}", &card, &error), DIO_BAD_FILE);
	assert_non_null(strstr(error.text, "\"deblock\" is neither true nor false"));
	assert_int_equal(read_card("{\"tokens_per_view\": \"many\"}", &card, &error), DIO_BAD_FILE);
	assert_int_equal(read_card("[", &card, &error), DIO_BAD_FILE);
	assert_non_null(strstr(error.text, "m.json"));
	assert_true(card.deblock);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_distorted_camera_becomes_a_pinhole_of_the_same_size),
		cmocka_unit_test(views_of_one_name_stay_apart),
		cmocka_unit_test(the_nearest_view_counts_distance_and_angle),
		cmocka_unit_test(the_patch_follows_the_tokens_of_the_training),
		cmocka_unit_test(a_card_states_what_weights_need_and_a_bad_one_is_refused),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
