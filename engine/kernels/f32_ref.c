/* The specification in plain C: double accumulators, libm, one rounding at the end. */
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"

static float finish(double product, float before, enum dvsm_epilogue epilogue)
{
	switch (epilogue) {
	case DVSM_EPILOGUE_ADD:
		return (float)(before + product);
	case DVSM_EPILOGUE_GELU:
		return (float)(0.5 * product * erfc(-product * M_SQRT1_2));
	case DVSM_EPILOGUE_STORE:
		break;
	}
	return (float)product;
}

static void gemm(const float *a, size_t a_stride, size_t rows, const float *panels, size_t depth,
		 size_t cols, float *c, size_t c_stride, enum dvsm_epilogue epilogue)
{
	for (size_t first = 0; first < cols; first += DVSM_PANEL) {
		const float *panel = panels + first * depth;
		size_t width = cols - first < DVSM_PANEL ? cols - first : DVSM_PANEL;

		for (size_t i = 0; i < rows; i++) {
			double sum[DVSM_PANEL] = {0};
			float *out = c + i * c_stride + first;

			for (size_t d = 0; d < depth; d++) {
				for (size_t j = 0; j < DVSM_PANEL; j++)
					sum[j] += (double)a[i * a_stride + d] *
						  panel[d * DVSM_PANEL + j];
			}
			for (size_t j = 0; j < width; j++)
				out[j] = finish(sum[j], out[j], epilogue);
		}
	}
}

static void layer_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       float *out)
{
	for (size_t i = 0; i < rows; i++, x += dim, out += dim) {
		double sum = 0, squares = 0;

		for (size_t d = 0; d < dim; d++)
			sum += x[d];
		double mean = sum / (double)dim;

		for (size_t d = 0; d < dim; d++)
			squares += (x[d] - mean) * (x[d] - mean);
		double inverse = 1 / sqrt(squares / (double)dim + eps);

		for (size_t d = 0; d < dim; d++)
			out[d] = (float)((x[d] - mean) * inverse * weight[d]);
	}
}

static void rms_norm(const float *x, size_t x_stride, size_t rows, size_t dim, const float *weight,
		     float eps, float *out, size_t out_stride)
{
	for (size_t i = 0; i < rows; i++, x += x_stride, out += out_stride) {
		double squares = 0;

		for (size_t d = 0; d < dim; d++)
			squares += (double)x[d] * x[d];
		double inverse = 1 / sqrt(squares / (double)dim + eps);

		for (size_t d = 0; d < dim; d++)
			out[d] = (float)(x[d] * inverse * weight[d]);
	}
}

/* One query: maximum, sum and weighted values so far; a new maximum rescales the other two. */
static void attend(const struct dvsm_attention *job, const float *q, double *sums, float *out)
{
	size_t dim = job->head_dim;
	double top = -INFINITY, total = 0;

	for (size_t d = 0; d < dim; d++)
		sums[d] = 0;
	for (size_t j = 0; j < job->keys; j++) {
		const float *k = job->k + j * dim, *v = job->v + j * dim;
		double score = 0, weight;

		for (size_t d = 0; d < dim; d++)
			score += (double)q[d] * k[d];
		score *= job->scale;
		if (score > top) {
			double shrink = exp(top - score);

			total *= shrink;
			for (size_t d = 0; d < dim; d++)
				sums[d] *= shrink;
			top = score;
		}
		weight = exp(score - top);
		total += weight;
		for (size_t d = 0; d < dim; d++)
			sums[d] += weight * v[d];
	}
	for (size_t d = 0; d < dim; d++)
		out[d] = total > 0 ? (float)(sums[d] / total) : 0.0f;
}

static void attention(const struct dvsm_attention *job)
{
	for (size_t i = 0; i < job->queries; i++)
		attend(job, job->q + i * job->q_stride, job->scratch,
		       job->out + i * job->out_stride);
}

static void to_colour(float *y, size_t count, bool sigmoid)
{
	for (size_t i = 0; i < count; i++)
		y[i] = sigmoid ? (float)(1 / (1 + exp(-(double)y[i]))) : 0.5f + 0.5f * y[i];
}

const struct dvsm_kernels dvsm_kernels_scalar = {
	.cpu = DVSM_CPU_SCALAR,
	.name = "scalar",
	.gemm = gemm,
	.layer_norm = layer_norm,
	.rms_norm = rms_norm,
	.attention = attention,
	.to_colour = to_colour,
};
