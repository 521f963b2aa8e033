/*
 * What the blocks of a run compute, noted in float32 and compared in fixed. Private to the engine;
 * a run without a trace spends one comparison a place on it.
 *
 * A pass is one reconstruction or rendering. Of its tokens a few are looked at, at equal distances:
 * which ones follows from their number alone, so that the float32 run and the fixed run of a pass
 * mean the same tokens in whatever order they come to them.
 */
#ifndef DVSM_FIXED_TRACE_H
#define DVSM_FIXED_TRACE_H

#include "kernels/fixed.h"
#include "model/model.h"

enum dvsm_trace_what {
	DVSM_TRACE_KEYS, /* less their mean over the tokens, which attention does not see */
	DVSM_TRACE_VALUES,
	DVSM_TRACE_ATTENTION, /* its output, in front of W_o */
	DVSM_TRACE_HIDDEN,    /* numbers of the MLP, behind GELU */
	DVSM_TRACE_OUTPUT,    /* the residual stream behind the half block */
	DVSM_TRACE_COUNT,
};

/** Squares of float32's numbers, and of the differences. */
struct dvsm_trace_energy {
	double numbers, errors;
};

/** Make with dvsm_trace_init(), release with dvsm_trace_deinit(). */
struct dvsm_trace {
	const struct dvsm_model *model;
	int key_fraction;       /* of the fixed model, once there is one */
	size_t passes, pass;    /* how many there are; begun so far */
	size_t tokens, stretch; /* of the pass: all, and those of which one is looked at */
	float *noted;           /* [passes][tokens looked at][2 layers] numbers; owned */
	double *row;            /* the row that is compared, at most the hidden numbers; owned */
	struct dvsm_trace_energy *energies; /* [2 layers][DVSM_TRACE_COUNT]; owned */
};

/** Room for `passes`; false without memory, with nothing to release. */
bool dvsm_trace_init(struct dvsm_trace *trace, const struct dvsm_model *model, size_t passes);
void dvsm_trace_deinit(struct dvsm_trace *trace);

/** From noting to comparing: the same passes again. */
void dvsm_trace_turn_round(struct dvsm_trace *trace, int key_fraction);

/** The next pass, of so many tokens; returns the trace, which may be NULL. */
struct dvsm_trace *dvsm_trace_begin(struct dvsm_trace *trace, size_t tokens);

/*
 * Rows are those of tokens `first` and on of the pass; `half` is 2 layer, plus 1 for the cross-view
 * half. Threads may note different tokens at once; what is fixed is compared by one thread.
 */

/** float32: x[rows][width]. */
void dvsm_trace_floats(struct dvsm_trace *trace, size_t half, enum dvsm_trace_what what,
		       size_t first, const float *x, size_t rows, size_t width);

/** float32: all keys and values of a layer, [heads][rows][D / heads]. */
void dvsm_trace_float_heads(struct dvsm_trace *trace, size_t half, size_t first, const float *keys,
			    const float *values, size_t rows);

/** Fixed: x[rows][width] in units of 2^-fraction, turned by `part` numbers, 0 for not. */
void dvsm_trace_narrow(struct dvsm_trace *trace, size_t half, enum dvsm_trace_what what,
		       size_t first, const int16_t *x, size_t rows, size_t width, int fraction,
		       size_t part);
void dvsm_trace_stream(struct dvsm_trace *trace, size_t half, size_t first, const int32_t *x,
		       size_t rows, int fraction);

/**
 * Fixed: keys and values kv[rows][2D] as int8 holds them.
 *
 * channels        [heads][2][D / heads]: keys, values
 * value_fraction  [D]
 */
void dvsm_trace_packed(struct dvsm_trace *trace, size_t half, size_t first, const int16_t *kv,
		       size_t rows, const struct dvsm_fixed_channel *channels,
		       const int16_t *value_fraction);

#endif
