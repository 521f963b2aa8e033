#include "fixed/trace.h"

#include <math.h>
#include <stdlib.h>

#include "fixed/turn.h"
#include "kernels/fixed_math.h"

/* Tokens that are looked at of each pass at most. */
#define SAMPLES 128u

/* From one sample's place within its stretch to the next one's: a stretch may be as long as a row
 * of patches, of which they should not all be the same. */
#define STEP 7u

static size_t width_of(const struct dvsm_trace *trace, enum dvsm_trace_what what)
{
	const struct dvsm_model_config *config = &trace->model->config;

	return what == DVSM_TRACE_HIDDEN ? (size_t)config->dim * config->mlp_ratio : config->dim;
}

/* Numbers of a token in front of those of `what`; with DVSM_TRACE_COUNT, all of half a block's. */
static size_t offset_of(const struct dvsm_trace *trace, enum dvsm_trace_what what)
{
	size_t offset = 0;

	for (int before = 0; before < (int)what; before++)
		offset += width_of(trace, (enum dvsm_trace_what)before);
	return offset;
}

bool dvsm_trace_init(struct dvsm_trace *trace, const struct dvsm_model *model, size_t passes)
{
	const size_t halves = 2 * (size_t)model->config.layers;

	*trace = (struct dvsm_trace){.model = model, .passes = passes};
	trace->energies = calloc(halves * DVSM_TRACE_COUNT, sizeof(*trace->energies));
	trace->row = calloc(width_of(trace, DVSM_TRACE_HIDDEN), sizeof(*trace->row));
	trace->noted = calloc(passes * SAMPLES,
			      halves * offset_of(trace, DVSM_TRACE_COUNT) * sizeof(*trace->noted));
	if (trace->energies && trace->row && trace->noted)
		return true;
	dvsm_trace_deinit(trace);
	return false;
}

void dvsm_trace_deinit(struct dvsm_trace *trace)
{
	free(trace->noted);
	free(trace->row);
	free(trace->energies);
}

void dvsm_trace_turn_round(struct dvsm_trace *trace, int key_fraction)
{
	trace->key_fraction = key_fraction;
	trace->pass = 0;
}

struct dvsm_trace *dvsm_trace_begin(struct dvsm_trace *trace, size_t tokens)
{
	if (!trace)
		return NULL;
	trace->pass++;
	trace->tokens = tokens;
	trace->stretch = (tokens + SAMPLES - 1) / SAMPLES;
	return trace;
}

/* ---- which tokens, and where their numbers are ---- */

/* Token of a sample; the last stretch may be too short to have it. */
static size_t token_of(const struct dvsm_trace *trace, size_t sample)
{
	return sample * trace->stretch + sample * STEP % trace->stretch;
}

/* The first sample at `first` or behind it. */
static size_t sample_from(const struct dvsm_trace *trace, size_t first)
{
	size_t sample = first / trace->stretch;

	return token_of(trace, sample) < first ? sample + 1 : sample;
}

static float *place(const struct dvsm_trace *trace, size_t half, enum dvsm_trace_what what,
		    size_t sample)
{
	const size_t halves = 2 * (size_t)trace->model->config.layers;
	size_t at = ((trace->pass - 1) * SAMPLES + sample) * halves + half;

	return trace->noted + at * offset_of(trace, DVSM_TRACE_COUNT) + offset_of(trace, what);
}

/* ---- noting ---- */

void dvsm_trace_floats(struct dvsm_trace *trace, size_t half, enum dvsm_trace_what what,
		       size_t first, const float *x, size_t rows, size_t width)
{
	for (size_t s = sample_from(trace, first); token_of(trace, s) < first + rows; s++) {
		const float *row = x + (token_of(trace, s) - first) * width;
		float *to = place(trace, half, what, s);

		for (size_t d = 0; d < width; d++)
			to[d] = row[d];
	}
}

static double mean(const float *numbers, size_t count, size_t stride)
{
	double sum = 0;

	for (size_t i = 0; i < count; i++)
		sum += (double)numbers[i * stride];
	return sum / (double)count;
}

void dvsm_trace_float_heads(struct dvsm_trace *trace, size_t half, size_t first, const float *keys,
			    const float *values, size_t rows)
{
	const size_t dim = trace->model->config.dim, width = dim / trace->model->config.heads;

	for (size_t d = 0; d < dim; d++) {
		const size_t at = d / width * rows * width + d % width;
		const double key_mean = mean(keys + at, rows, width);

		for (size_t s = sample_from(trace, first); token_of(trace, s) < first + rows; s++) {
			size_t number = at + (token_of(trace, s) - first) * width;

			place(trace, half, DVSM_TRACE_KEYS, s)[d] =
				(float)((double)keys[number] - key_mean);
			place(trace, half, DVSM_TRACE_VALUES, s)[d] = values[number];
		}
	}
}

/* ---- comparing ---- */

/* The row, once turned back by `part` numbers (0: it is not turned), with what was noted. */
static void compare(struct dvsm_trace *trace, size_t half, enum dvsm_trace_what what, size_t sample,
		    size_t part)
{
	struct dvsm_trace_energy *energy = &trace->energies[half * DVSM_TRACE_COUNT + what];
	const float *noted = place(trace, half, what, sample);
	const size_t width = width_of(trace, what);

	if (part > 0) {
		for (size_t d = 0; d < width; d += part)
			dvsm_fixed_turn(trace->row + d, part, 1);
	}
	for (size_t d = 0; d < width; d++) {
		double want = (double)noted[d], error = trace->row[d] - want;

		energy->numbers += want * want;
		energy->errors += error * error;
	}
}

void dvsm_trace_narrow(struct dvsm_trace *trace, size_t half, enum dvsm_trace_what what,
		       size_t first, const int16_t *x, size_t rows, size_t width, int fraction,
		       size_t part)
{
	for (size_t s = sample_from(trace, first); token_of(trace, s) < first + rows; s++) {
		const int16_t *row = x + (token_of(trace, s) - first) * width;

		for (size_t d = 0; d < width; d++)
			trace->row[d] = ldexp(row[d], -fraction);
		compare(trace, half, what, s, part);
	}
}

void dvsm_trace_stream(struct dvsm_trace *trace, size_t half, size_t first, const int32_t *x,
		       size_t rows, int fraction)
{
	const size_t dim = trace->model->config.dim;

	for (size_t s = sample_from(trace, first); token_of(trace, s) < first + rows; s++) {
		const int32_t *row = x + (token_of(trace, s) - first) * dim;

		for (size_t d = 0; d < dim; d++)
			trace->row[d] = ldexp(row[d], -fraction);
		compare(trace, half, DVSM_TRACE_OUTPUT, s, dim);
	}
}

/* A number less its channel's mean, as int8 and its scale give it back. */
static double through_int8(int16_t x, const struct dvsm_fixed_channel *channel)
{
	int32_t centred = dvsm_fixed_saturate((int64_t)x - channel->mean);
	int64_t wide = dvsm_fixed_saturate((int64_t)centred * (1 << channel->shift));
	int64_t number = dvsm_fixed_round(wide * channel->inverse, 15);

	return channel->inverse ? (double)number * ldexp(1, 15 - channel->shift) / channel->inverse
				: 0;
}

void dvsm_trace_packed(struct dvsm_trace *trace, size_t half, size_t first, const int16_t *kv,
		       size_t rows, const struct dvsm_fixed_channel *channels,
		       const int16_t *value_fraction)
{
	const size_t dim = trace->model->config.dim, width = dim / trace->model->config.heads;
	const struct dvsm_block_weights *block = &trace->model->weights.blocks[half / 2];
	const float *k_norm = half % 2 ? block->cross.k_norm : block->intra.k_norm;

	for (size_t s = sample_from(trace, first); token_of(trace, s) < first + rows; s++) {
		const int16_t *row = kv + (token_of(trace, s) - first) * 2 * dim;

		for (size_t d = 0; d < dim; d++) {
			size_t channel = d / width * 2 * width + d % width;
			double key = through_int8(row[d], &channels[channel]);

			trace->row[d] =
				ldexp(key, -trace->key_fraction) * (double)k_norm[d % width];
		}
		compare(trace, half, DVSM_TRACE_KEYS, s, 0);
		for (size_t d = 0; d < dim; d++) {
			size_t channel = (d / width * 2 + 1) * width + d % width;
			double value = through_int8(row[dim + d], &channels[channel]);

			trace->row[d] = ldexp(channels[channel].mean + value, -value_fraction[d]);
		}
		compare(trace, half, DVSM_TRACE_VALUES, s, width);
	}
}
