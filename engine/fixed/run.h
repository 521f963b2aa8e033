/* One run of the fixed-point transformer: its memory and its steps. Private to the engine. */
#ifndef DVSM_FIXED_RUN_H
#define DVSM_FIXED_RUN_H

#include <stdatomic.h>

#include "fixed/layer.h"
#include "forward/workspace.h"
#include "threads/pool.h"

/** D = dim, h = heads, N = tokens of the largest view, q = patch side. */
struct dvsm_fixed_workspace {
	int32_t *x;                          /* [tokens][D] residual stream */
	int8_t *a, *a_low;                   /* [N][widest] input of a product, and its low plane */
	struct dvsm_fixed_scale *a_scale;    /* [N] */
	int16_t *wide;                       /* [N][max(hidden, D)] queries; hidden numbers */
	int16_t *mixed;                      /* [N][D] attention's output */
	int16_t *kv;                         /* [tokens][2D] keys and values before packing */
	int8_t *q;                           /* [N][h][head_width] */
	struct dvsm_fixed_scale *q_scale;    /* [N][h] */
	struct dvsm_fixed_range *ranges;     /* [2D] */
	struct dvsm_fixed_channel *channels; /* [2D] */
	struct dvsm_fixed_layer own;         /* of the view at hand */
	struct dvsm_fixed_slots slots;
	float *patches;         /* [N][6qq] rays, or colours */
	int32_t *sums;          /* [N][max(3qq, D)] embedding before its norm; picture */
	unsigned char *scratch; /* [threads][scratch_stride] */
	size_t scratch_stride;
};

/** Everything a step needs; borrowed for one reconstruction or rendering. */
struct dvsm_fixed_run {
	const struct dvsm_model_config *config;
	const struct dvsm_fixed_model *model;
	const struct dvsm_fixed_kernels *kernels;
	struct dvsm_pool *pool;
	struct dvsm_fixed_workspace work;
	_Atomic uint64_t *clamped; /* counts colours that were; used by rendering alone */
};

/** Walk the workspace: measures or places, as the arena says. */
struct dvsm_fixed_workspace dvsm_fixed_workspace_place(struct dvsm_arena *arena,
						       const struct dvsm_model_config *config,
						       const struct dvsm_job_size *size);

/** The scratch of one thread. */
static inline void *dvsm_fixed_scratch(const struct dvsm_fixed_run *run, uint32_t worker)
{
	return run->work.scratch + worker * run->work.scratch_stride;
}

/** work.a = LN(x[rows][D]) in int8, in two planes when fine. */
void dvsm_fixed_step_norm(const struct dvsm_fixed_run *run, const int32_t *x, size_t rows,
			  const struct dvsm_fixed_gain *gain, bool fine);

/** work.a = x[rows][dim] in int8, rows without gap, in units of 2^-fraction. */
void dvsm_fixed_step_quantise(const struct dvsm_fixed_run *run, const int16_t *x, size_t rows,
			      size_t dim, int fraction);

/** c[rows][W.out] = epilogue(a[rows] W^T), rows of c without gap. */
void dvsm_fixed_step_product(const struct dvsm_fixed_run *run, const int8_t *a, size_t rows,
			     const struct dvsm_fixed_matrix *w, void *c,
			     enum dvsm_fixed_epilogue epilogue, int fraction);

/** work.q from 16-bit queries u[rows][D]. */
void dvsm_fixed_step_queries(const struct dvsm_fixed_run *run, const int16_t *u, size_t rows,
			     const struct dvsm_fixed_slots *slots);

/** QK-norm of the keys of kv[rows][2D] in place. */
void dvsm_fixed_step_keys(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			  int16_t *kv, size_t rows);

/** Pack kv[layer->tokens][2D] into the layer, with scales over all of its tokens. */
void dvsm_fixed_step_pack(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			  const int16_t *kv, struct dvsm_fixed_layer *layer);

/** work.mixed[rows][D] = attention of work.q to a layer. */
void dvsm_fixed_step_attention(const struct dvsm_fixed_run *run, size_t rows,
			       const struct dvsm_fixed_layer *layer);

#endif
