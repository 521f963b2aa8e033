/* One run of the fixed-point transformer: its memory and its steps. Private to the engine. */
#ifndef DVSM_FIXED_RUN_H
#define DVSM_FIXED_RUN_H

#include <stdatomic.h>

#include "fixed/layer.h"
#include "fixed/trace.h"
#include "geometry/group.h"
#include "threads/pool.h"

/** Views that are worked on together; a unit is what their packed keys are filled up to. */
#define DVSM_FIXED_GROUPING ((struct dvsm_grouping){DVSM_FIXED_KEY_PAD, 512})

/**
 * D = dim, h = heads, N = tokens of the largest view, G and V = rows and views of the largest
 * group, q = patch side. Rows of a group's views follow each other without gap.
 */
struct dvsm_fixed_workspace {
	int32_t *x;                          /* [tokens][D] residual stream */
	int8_t *a, *a_low;                   /* [G][widest] inputs of products, or its low plane */
	struct dvsm_fixed_scale *a_scale;    /* [G] */
	int16_t *wide;                       /* [G][max(hidden, D)] queries; hidden numbers */
	int16_t *mixed;                      /* [G][D] attention's output */
	int16_t *kv;                         /* [tokens][2D] keys and values before packing */
	struct dvsm_fixed_range *ranges;     /* [V][h][2][D/h] of keys and values */
	struct dvsm_fixed_channel *channels; /* likewise */
	int8_t *own_keys, *own_values;       /* [G][h x padded head] packed, of each view in turn */
	struct dvsm_fixed_layer_scales scales; /* [V][D] each, of the views' own layers */
	_Atomic uint32_t *left; /* [G / least rows of a task] tasks that rows wait for */
	float *patches;         /* [N][6qq] rays, or colours */
	int32_t *sums;          /* [N][max(3qq, D)] embedding before its norm; picture */
	unsigned char *scratch; /* [threads][scratch_stride] */
	size_t scratch_stride;
};

/** Rows of a task of a product or of attention, at most and, unless there are fewer, at least. */
#define DVSM_FIXED_TASK_ROWS       64u
#define DVSM_FIXED_LEAST_TASK_ROWS 32u

/** Rows whose planes a thread's scratch holds. */
#define DVSM_FIXED_FEW_ROWS 16u

/** What attention to one head needs of a thread's scratch. */
struct dvsm_fixed_head_scratch {
	int8_t *q;                        /* [DVSM_FIXED_MOST_QUERIES][fine width] */
	struct dvsm_fixed_scale *q_scale; /* [DVSM_FIXED_MOST_QUERIES] */
	int16_t *gains;                   /* [dim of the head] */
	void *rest;                       /* the kernel's; before, fine queries in 16 bits */
	size_t bytes;                     /* of everything */
};

/** Place (or, without a base, measure) it. */
static inline struct dvsm_fixed_head_scratch dvsm_fixed_head_scratch_place(void *base, size_t dim)
{
	struct dvsm_arena arena = {.base = base};
	struct dvsm_fixed_head_scratch made;

	made.q = dvsm_arena_take(&arena, DVSM_FIXED_MOST_QUERIES, dvsm_fixed_fine_width(dim));
	made.q_scale = dvsm_arena_take(&arena, DVSM_FIXED_MOST_QUERIES, sizeof(*made.q_scale));
	made.gains = dvsm_arena_take(&arena, dim, sizeof(*made.gains));
	made.rest = dvsm_arena_take(
		&arena, dvsm_fixed_attention_scratch(dvsm_fixed_pad(dim, DVSM_FIXED_HEAD)), 1);
	made.bytes = arena.used;
	return made;
}

/** Everything a step needs; borrowed for one reconstruction or rendering. */
struct dvsm_fixed_run {
	const struct dvsm_model_config *config;
	const struct dvsm_fixed_model *model;
	const struct dvsm_fixed_kernels *kernels;
	struct dvsm_pool *pool;
	struct dvsm_trace *trace; /* NULL, or compares what the blocks compute */
	bool deblock;             /* rendered pictures */
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

/*
 * Steps. Each is one job of the pool; `then` is what is done to rows as soon as the job is done
 * with them, by the thread that did the last of it.
 */

/** The step behind a job's rows. */
struct dvsm_fixed_then {
	enum {
		DVSM_FIXED_NOTHING,
		DVSM_FIXED_NORM,     /* work.a = LN(x) with gain, as `input` takes it */
		DVSM_FIXED_KEYS_16,  /* QK-norm of the keys of kv[rows][2D] in place */
		DVSM_FIXED_QUANTISE, /* to = wide, in units of 2^-fraction, as `input` takes it */
	} what;
	const struct dvsm_fixed_matrix *input;
	const int32_t *x;
	const struct dvsm_fixed_gain *gain;
	const struct dvsm_fixed_half *half;
	int16_t *kv;
	const int16_t *wide;
	int8_t *to;
	int fraction;
};

/** work.a = LN(x[rows][D]) as the matrix takes its input. */
void dvsm_fixed_step_norm(const struct dvsm_fixed_run *run, const int32_t *x, size_t rows,
			  const struct dvsm_fixed_gain *gain,
			  const struct dvsm_fixed_matrix *input);

/** The same 256 times finer, the low plane to work.a_low: for a product of each. */
void dvsm_fixed_step_norm_planes(const struct dvsm_fixed_run *run, const int32_t *x, size_t rows,
				 const struct dvsm_fixed_gain *gain);

/** A product: c[rows][W.out] = epilogue(a[rows] W^T), rows of c without gap. */
struct dvsm_fixed_product {
	const int8_t *a;
	const struct dvsm_fixed_matrix *w;
	void *c;
	enum dvsm_fixed_epilogue epilogue;
	int fraction;
	struct dvsm_fixed_then then;
};

/** Up to two products of as many rows; only the first may have something behind it. */
void dvsm_fixed_step_products(const struct dvsm_fixed_run *run, size_t rows,
			      const struct dvsm_fixed_product *products, size_t count);

/**
 * Where keys and values of some rows are: those of a view's own rows in a layer of its own, or all
 * rows' in one.
 */
struct dvsm_fixed_layers {
	const struct dvsm_group *group; /* NULL: one layer */
	struct dvsm_fixed_layer one;
};

/** The layer of a view, with its place among the group's. */
struct dvsm_fixed_layer dvsm_fixed_layers_get(const struct dvsm_fixed_run *run,
					      const struct dvsm_fixed_layers *layers,
					      uint32_t view);

/** Pack kv[tokens][2D] of all layers into them, with scales over all of a layer's tokens. */
void dvsm_fixed_step_pack(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			  const int16_t *kv, const struct dvsm_fixed_layers *layers);

/** work.mixed[rows][D] = attention of the 16-bit queries u[rows][D] to their layers. */
void dvsm_fixed_step_attention(const struct dvsm_fixed_run *run, const struct dvsm_fixed_half *half,
			       const int16_t *u, size_t rows,
			       const struct dvsm_fixed_layers *layers, struct dvsm_fixed_then then);

#endif
