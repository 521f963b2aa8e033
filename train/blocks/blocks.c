#include "blocks.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "memory.h"
#include "network.h"
#include "tiles.h"
#include "vector.h"

/* --- threads: each takes the next scene --- */

struct worker {
	struct dio_blocks *b;
	struct scratch *scratch;
	void (*scene)(struct dio_blocks *, struct scratch *, int index);
	pthread_t thread;
	bool started;
};

static void *work(void *argument)
{
	struct worker *worker = argument;
	tiles_configure();
	for (;;) {
		int index = atomic_fetch_add(&worker->b->next, 1);
		if (index >= worker->b->scenes) {
			break;
		}
		worker->scene(worker->b, worker->scratch, index);
	}
	tiles_release();
	return NULL;
}

static int run_threads(struct dio_blocks *b,
		       void (*scene)(struct dio_blocks *, struct scratch *, int))
{
	struct worker workers[MAX_THREADS] = {0};
	int count = b->threads < b->scenes ? b->threads : b->scenes, started = 0;
	atomic_store(&b->next, 0);
	for (int i = 0; i < count; i++) {
		workers[i] = (struct worker){b, &b->scratch[i], scene, 0, false};
		workers[i].started =
			pthread_create(&workers[i].thread, NULL, work, &workers[i]) == 0;
		started += workers[i].started;
	}
	for (int i = 0; i < count; i++) {
		if (workers[i].started) {
			pthread_join(workers[i].thread, NULL);
		}
	}
	return started > 0 ? 0 : -1;
}

static void scene_forward(struct dio_blocks *b, struct scratch *t, int index)
{
	struct scene *scene = &b->scene[index];
	size_t dim = (size_t)b->dim, context = (size_t)b->context * b->near * dim;
	size_t targets = (size_t)b->targets * b->far * dim;
	float *far = scene->x + (size_t)b->context_rows * dim;
	memset(scene->x, 0, (size_t)b->rows * dim * sizeof(float));
	memcpy(scene->x, b->near_in + (size_t)index * context, context * sizeof(float));
	memcpy(far, b->far_in + (size_t)index * targets, targets * sizeof(float));
	for (int i = 0; i < 2 * b->layers; i++) {
		half_forward(b, i, t, scene);
	}
	memcpy(b->far_out + (size_t)index * targets, far, targets * sizeof(float));
}

static void scene_backward(struct dio_blocks *b, struct scratch *t, int index)
{
	struct scene *scene = &b->scene[index];
	size_t dim = (size_t)b->dim, context = (size_t)b->context * b->near * dim;
	size_t targets = (size_t)b->targets * b->far * dim;
	float *far = scene->x + (size_t)b->context_rows * dim;
	memset(scene->x, 0, (size_t)b->rows * dim * sizeof(float));
	memcpy(far, b->far_in + (size_t)index * targets, targets * sizeof(float));
	for (int i = 2 * b->layers - 1; i >= 0; i--) {
		half_backward(b, i, t, scene);
	}
	memcpy(b->near_out + (size_t)index * context, scene->x, context * sizeof(float));
	memcpy(b->far_out + (size_t)index * targets, far, targets * sizeof(float));
}

/* --- the interface --- */

int dio_blocks_supported(void)
{
	return tiles_supported();
}

struct dio_blocks *dio_blocks_create(int dim, int heads, int layers, float eps, int threads,
				     unsigned options)
{
	if (dim <= 0 || layers <= 0 || heads <= 0 || dim != heads * HEAD || !tiles_supported()) {
		return NULL;
	}
	struct dio_blocks *b = calloc(1, sizeof(*b));
	if (!b) {
		return NULL;
	}
	b->dim = dim;
	b->heads = heads;
	b->layers = layers;
	b->hidden = 4 * dim;
	b->eps = eps;
	b->shared = !(options & DIO_BLOCKS_TWO_STAGES);
	b->lone = options & DIO_BLOCKS_LONE_VIEWS;
	b->threads = threads < 1 ? 1 : threads > MAX_THREADS ? MAX_THREADS : threads;
	size_t square = (size_t)dim * dim, width = (size_t)dim;
	size_t sizes[HALF_TENSORS] = {width,  3 * square, HEAD,       HEAD,
				      square, width,      4 * square, 4 * square};
	for (int k = 0; k < HALF_TENSORS; k++) {
		b->offsets[k] = b->half_floats;
		b->half_floats += (sizes[k] + 15) & ~(size_t)15;
	}
	b->halves = calloc((size_t)layers * 2 * (size_t)stages(b), sizeof(*b->halves));
	b->packed = b->halves ? allocate(weights_place(b, NULL)) : NULL;
	if (!b->packed) {
		dio_blocks_destroy(b);
		return NULL;
	}
	weights_place(b, b->packed);
	return b;
}

void dio_blocks_destroy(struct dio_blocks *b)
{
	if (b) {
		free(b->batch);
		free(b->packed);
		free(b->halves);
		free(b);
	}
}

int dio_blocks_forward(struct dio_blocks *b, const float *const *weights, int scenes, int context,
		       int near, int targets, int far, const float *given, const float *asked,
		       float *y)
{
	if (scenes < 1 || context < 1 || near < 1 || targets < 1 || far < 1 ||
	    batch_shape(b, scenes, context, near, targets, far) != 0) {
		return -1;
	}
	weights_pack(b, weights);
	b->near_in = given;
	b->far_in = asked;
	b->far_out = y;
	return run_threads(b, scene_forward);
}

int dio_blocks_backward(struct dio_blocks *b, const float *dy, float *dgiven, float *dasked,
			float *const *gradients)
{
	if (!b->scene) {
		return -1;
	}
	int used = b->threads < b->scenes ? b->threads : b->scenes;
	for (int i = 0; i < used; i++) {
		memset(b->scratch[i].gradients, 0, gradient_floats(b) * sizeof(float));
	}
	b->far_in = dy;
	b->near_out = dgiven;
	b->far_out = dasked;
	if (run_threads(b, scene_backward) != 0) {
		return -1;
	}
	size_t square = (size_t)b->dim * b->dim, width = (size_t)b->dim;
	size_t sizes[HALF_TENSORS] = {width,  3 * square, HEAD,       HEAD,
				      square, width,      4 * square, 4 * square};
	for (int i = 0; i < 2 * b->layers * stages(b); i++) {
		for (int k = 0; k < HALF_TENSORS; k++) {
			float *to = gradients[i * HALF_TENSORS + k];
			size_t at = b->half_floats * (size_t)i + b->offsets[k];
			memcpy(to, b->scratch[0].gradients + at, sizes[k] * sizeof(float));
			for (int t = 1; t < used; t++) {
				const float *from = b->scratch[t].gradients + at;
				for (size_t n = 0; n < sizes[k]; n += 16) {
					_mm512_storeu_ps(to + n,
							 _mm512_add_ps(_mm512_loadu_ps(to + n),
								       _mm512_loadu_ps(from + n)));
				}
			}
		}
	}
	return 0;
}
