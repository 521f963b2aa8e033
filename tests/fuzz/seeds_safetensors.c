/* The first corpus of fuzz_safetensors: a small model of each number type, and a scene. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "file_fixture.h"
#include "scene_fixture.h"

static int write_model(const char *folder, const char *dtype)
{
	char path[4096];
	struct fixture_file file;
	size_t size;
	fixture_init_model(&file, dtype);
	unsigned char *bytes = fixture_emit(&file, &size);
	snprintf(path, sizeof(path), "%s/model-%s", folder, dtype);
	FILE *out = fopen(path, "wb");
	int failed = !out || fwrite(bytes, 1, size, out) != size;
	if (out && fclose(out) != 0)
		failed = 1;
	free(bytes);
	fixture_deinit(&file);
	return failed;
}

static int write_scene(const char *folder)
{
	char path[4096];
	struct dvsm_model *model = scene_fixture_model();
	struct dvsm_scene *scene = scene_fixture_make(model);
	snprintf(path, sizeof(path), "%s/scene", folder);
	int failed = dvsm_scene_save(scene, path, NULL) != DVSM_OK;
	dvsm_scene_destroy(scene);
	dvsm_model_close(model);
	return failed;
}

int main(int argc, char **argv)
{
	static const char *const dtypes[] = {"F32", "F16", "BF16"};
	if (argc != 2) {
		fprintf(stderr, "usage: %s FOLDER\n", argv[0]);
		return 2;
	}
	int failed = write_scene(argv[1]);
	for (int i = 0; i < 3; i++)
		failed |= write_model(argv[1], dtypes[i]);
	if (failed)
		fprintf(stderr, "%s: cannot write the corpus to %s\n", argv[0], argv[1]);
	return failed;
}
