/* A small scene with random keys and values, and the model that goes with it. */
#ifndef SCENE_FIXTURE_H
#define SCENE_FIXTURE_H

#include "dvsm/dvsm.h"
#include "scene/scene_internal.h"

#define SCENE_FIXTURE_VIEWS 3

/** The tiny model of file_fixture.h; release with dvsm_model_close(). */
struct dvsm_model *scene_fixture_model(void);

/** Three views of differing sizes, stage patch 16; release with dvsm_scene_destroy(). */
struct dvsm_scene *scene_fixture_make(const struct dvsm_model *model);

/** All bytes of a file; release with free(). */
unsigned char *scene_fixture_read(const char *path, size_t *size);

#endif
