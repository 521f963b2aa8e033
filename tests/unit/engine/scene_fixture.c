#include "scene_fixture.h"

#include <stdio.h>
#include <stdlib.h>

#include "check.h"
#include "file_fixture.h"
#include "rig_fixture.h"

struct dvsm_model *scene_fixture_model(void)
{
	struct fixture_file file;
	struct dvsm_model *model = NULL;
	size_t size;
	fixture_init_model(&file, "F32");
	unsigned char *bytes = fixture_emit(&file, &size);
	assert_int_equal(fixture_open_model(bytes, size, &model, NULL), DVSM_OK);
	free(bytes);
	fixture_deinit(&file);
	return model;
}

struct dvsm_scene *scene_fixture_make(const struct dvsm_model *model)
{
	struct dvsm_camera rig[SCENE_FIXTURE_VIEWS];
	rig_make_arc(rig, SCENE_FIXTURE_VIEWS);
	rig[1].width = 35;
	rig[2].height = 61;
	struct dvsm_scene *scene = NULL;
	assert_int_equal(dvsm_scene_allocate(dvsm_model_get_config(model),
					     dvsm_model_get_sha256(model), DVSM_PRECISION_F32, rig,
					     SCENE_FIXTURE_VIEWS, 16, &scene, NULL),
			 DVSM_OK);
	uint64_t state = 9;
	size_t count = (size_t)scene->layers * scene->tokens * scene->dim;
	float *keys = scene->keys, *values = scene->values;
	for (size_t i = 0; i < count; i++) {
		keys[i] = (float)fixture_random(&state);
		values[i] = (float)fixture_random(&state);
	}
	return scene;
}

unsigned char *scene_fixture_read(const char *path, size_t *size)
{
	FILE *file = fopen(path, "rb");
	assert_non_null(file);
	assert_int_equal(fseek(file, 0, SEEK_END), 0);
	*size = (size_t)ftell(file);
	rewind(file);
	unsigned char *bytes = malloc(*size);
	assert_non_null(bytes);
	assert_int_equal(fread(bytes, 1, *size, file), *size);
	fclose(file);
	return bytes;
}
