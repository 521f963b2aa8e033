/* The memory that one run of the transformer works in. Private to the engine. */
#ifndef DVSM_FORWARD_WORKSPACE_H
#define DVSM_FORWARD_WORKSPACE_H

#include "dvsm/camera.h"
#include "dvsm/model.h"
#include "forward/arena.h"

struct dvsm_kernels;

/** What a run needs room for. */
struct dvsm_job_size {
	size_t tokens;        /* of all pictures together: the residual stream */
	size_t view_tokens;   /* of the largest picture: everything else is done a view at a time */
	size_t scratch_bytes; /* of each thread */
	uint32_t threads;
};

/** D = dim, h = heads, N = view_tokens. */
struct dvsm_workspace {
	float *x;     /* [tokens][D] residual stream */
	void *normed; /* left side [N][D]: input of a product, then attention's output */
	float *wide;  /* [N][wide_width] patches; q, k, v; MLP hidden (left side); output patches */
	size_t wide_width;
	void *patches;          /* left side [N][6 q q]: `wide` itself where numbers are floats */
	void *keys;             /* numbers [h][N][D/h] of the view at hand */
	void *values;           /* numbers [h][N][D/h] */
	unsigned char *scratch; /* [threads][scratch_stride] */
	size_t scratch_stride;
};

/** Size of a run over pictures of these checked cameras, [count]. */
struct dvsm_job_size dvsm_job_size_of(const struct dvsm_model_config *config,
				      const struct dvsm_camera *cameras, uint32_t count,
				      uint32_t patch_px, uint32_t threads);

/** Walk the workspace: measures or places, as the arena says. */
struct dvsm_workspace dvsm_workspace_place(struct dvsm_arena *arena,
					   const struct dvsm_model_config *config,
					   const struct dvsm_job_size *size,
					   const struct dvsm_kernels *kernels);

#endif
