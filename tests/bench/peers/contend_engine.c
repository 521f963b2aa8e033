/* The engine itself: from posed pictures to a picture, ray maps and all. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/work.h"
#include "talk.h"

struct contender {
	struct dio_work work;
	struct dvsm_engine *engine;
	struct dvsm_scene *scene;
	struct dvsm_camera target;
	float *rgb;
};

static void must(enum dvsm_status status, const struct dvsm_error *error)
{
	if (status != DVSM_OK)
		talk_fail(error->text);
}

static void reconstruct(void *context)
{
	struct contender *self = context;
	struct dvsm_error error = {0};

	dvsm_scene_destroy(self->scene);
	self->scene = NULL;
	must(dvsm_reconstruct(self->engine, self->work.context, self->work.views.context_count,
			      self->work.config.patch_px, NULL, NULL, &self->scene, NULL, &error),
	     &error);
}

static void render(void *context)
{
	struct contender *self = context;
	struct dvsm_error error = {0};

	must(dvsm_render(self->engine, self->scene, &self->target, self->work.config.patch_px,
			 self->rgb, NULL, &error),
	     &error);
}

static enum dvsm_precision find_precision(const char *name)
{
	for (unsigned p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++)
		if (strcmp(dvsm_precision_name(p), name) == 0)
			return p;
	talk_fail("a precision is f32, bf16 or fixed");
}

int main(int argc, char **argv)
{
	struct contender self = {0};
	struct dio_error fault = {0};
	struct dvsm_error error = {0};

	if (argc != 5 && (argc != 6 || strcmp(argv[5], "avx2") != 0))
		talk_fail("usage: contend_engine MODEL SCENE PRECISION THREADS [avx2]");
	if (dio_work_open(dio_draw_find("small"), argv[1], find_precision(argv[3]), argv[2], 0,
			  &self.work, &fault) != DIO_OK)
		talk_fail(fault.text);

	const struct dvsm_engine_options options = {
		.precision = self.work.precision,
		.threads = (uint32_t)strtoul(argv[4], NULL, 10),
		.cpu_mask = argc == 6 ? DVSM_CPU_SSE2 | DVSM_CPU_AVX2 : DVSM_CPU_ALL};
	const struct dio_view *target = &self.work.views.target[0];
	const size_t count = (size_t)target->camera.width * target->camera.height * 3;
	const struct talk talk = {&self, reconstruct, render,
				  self.rgb = malloc(count * sizeof(float)), count};
	char about[64];

	if (!self.rgb)
		talk_fail("no memory for a picture");
	must(dvsm_engine_create(self.work.model, &options, &self.engine, &error), &error);
	self.target = dio_view_engine_camera(&target->camera, &target->pose);
	snprintf(about, sizeof about, "Diorama, %s", dvsm_engine_get_cpu(self.engine));
	talk_serve(about, &talk);
	dvsm_scene_destroy(self.scene);
	dvsm_engine_destroy(self.engine);
	dio_work_deinit(&self.work);
	free(self.rgb);
	return 0;
}
