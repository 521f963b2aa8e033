/*
 * Template: the specification in plain C: double accumulators, libm, one rounding at the end.
 * Included once by each <precision>_ref.c after
 *
 *   number           the type of a number
 *   widen(number)    its float
 *   narrow(double)   rounded to a number, once
 *   round_weight(double)   a query or a weight of attention, as precise as they are kept
 *   panel_place(row, d, depth)   where weight [row][d] lies in the panels
 */
#include <math.h>

static void finish(void *c, size_t at, double product, enum dvsm_epilogue epilogue)
{
	float *floats = c;

	switch (epilogue) {
	case DVSM_EPILOGUE_ADD:
		floats[at] = (float)(floats[at] + product);
		break;
	case DVSM_EPILOGUE_GELU:
		((number *)c)[at] = narrow(0.5 * product * erfc(-product * M_SQRT1_2));
		break;
	case DVSM_EPILOGUE_STORE:
		floats[at] = (float)product;
		break;
	}
}

static void gemm(const void *a, size_t a_stride, size_t rows, const void *panels, size_t depth,
		 size_t cols, void *c, size_t c_stride, enum dvsm_epilogue epilogue)
{
	const number *weights = panels;

	for (size_t i = 0; i < rows; i++) {
		const number *row = (const number *)a + i * a_stride;

		for (size_t j = 0; j < cols; j++) {
			double sum = 0;

			for (size_t d = 0; d < depth; d++)
				sum += (double)widen(row[d]) *
				       widen(weights[panel_place(j, d, depth)]);
			finish(c, i * c_stride + j, sum, epilogue);
		}
	}
}

/* 1 / sqrt(mean of (x - shift)^2 + eps) */
static double inverse_spread(const float *x, size_t dim, double shift, float eps)
{
	double squares = 0;

	for (size_t d = 0; d < dim; d++)
		squares += (x[d] - shift) * (x[d] - shift);
	return 1 / sqrt(squares / (double)dim + eps);
}

static double mean_of(const float *x, size_t dim)
{
	double sum = 0;

	for (size_t d = 0; d < dim; d++)
		sum += x[d];
	return sum / (double)dim;
}

static void embed_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       void *out)
{
	float *to = out;

	for (size_t i = 0; i < rows; i++, x += dim, to += dim) {
		double mean = mean_of(x, dim), inverse = inverse_spread(x, dim, mean, eps);

		for (size_t d = 0; d < dim; d++)
			to[d] = (float)((x[d] - mean) * inverse * weight[d]);
	}
}

static void layer_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       void *out)
{
	number *to = out;

	for (size_t i = 0; i < rows; i++, x += dim, to += dim) {
		double mean = mean_of(x, dim), inverse = inverse_spread(x, dim, mean, eps);

		for (size_t d = 0; d < dim; d++)
			to[d] = narrow((x[d] - mean) * inverse * weight[d]);
	}
}

static void query_norm(const float *x, size_t x_stride, size_t rows, size_t dim,
		       const float *weight, float eps, void *out, size_t out_stride)
{
	float *to = out;

	for (size_t i = 0; i < rows; i++, x += x_stride, to += out_stride) {
		double inverse = inverse_spread(x, dim, 0, eps);

		for (size_t d = 0; d < dim; d++)
			to[d] = (float)(x[d] * inverse * weight[d]);
	}
}

static void key_norm(const float *x, size_t x_stride, size_t rows, size_t dim, const float *weight,
		     float eps, void *out, size_t out_stride)
{
	number *to = out;

	for (size_t i = 0; i < rows; i++, x += x_stride, to += out_stride) {
		double inverse = inverse_spread(x, dim, 0, eps);

		for (size_t d = 0; d < dim; d++)
			to[d] = narrow(x[d] * inverse * weight[d]);
	}
}

static void convert(const float *x, size_t x_stride, size_t rows, size_t dim, void *out,
		    size_t out_stride)
{
	number *to = out;

	for (size_t i = 0; i < rows; i++, x += x_stride, to += out_stride) {
		for (size_t d = 0; d < dim; d++)
			to[d] = narrow(x[d]);
	}
}

static void left(const float *x, size_t x_stride, size_t rows, size_t dim, void *out,
		 size_t out_stride, size_t out_col)
{
	convert(x, x_stride, rows, dim, (number *)out + out_col, out_stride);
}

/*
 * One query, already a row of numbers times scale log2(e): maximum, sum and weighted values so far;
 * a new maximum rescales the other two.
 */
static void attend(const struct dvsm_attention *job, const double *q, double *sums, number *out)
{
	size_t dim = job->head_dim;
	const number *k = job->k, *v = job->v;
	double top = -INFINITY, total = 0;

	for (size_t d = 0; d < dim; d++)
		sums[d] = 0;
	for (size_t j = 0; j < job->keys; j++, k += dim, v += dim) {
		double score = 0, weight;

		for (size_t d = 0; d < dim; d++)
			score += q[d] * widen(k[d]);
		if (score > top) {
			double shrink = exp2(top - score);

			total *= shrink;
			for (size_t d = 0; d < dim; d++)
				sums[d] *= shrink;
			top = score;
		}
		weight = round_weight(exp2(score - top));
		total += weight;
		for (size_t d = 0; d < dim; d++)
			sums[d] += weight * widen(v[d]);
	}
	for (size_t d = 0; d < dim; d++)
		out[d] = total > 0 ? narrow(sums[d] / total) : 0;
}

static void attention(const struct dvsm_attention *job)
{
	double *q = job->scratch, *sums = q + job->head_dim;

	for (size_t i = 0; i < job->queries; i++) {
		for (size_t d = 0; d < job->head_dim; d++)
			q[d] = round_weight(job->q[i * job->q_stride + d] * (double)job->scale *
					    M_LOG2E);
		attend(job, q, sums, (number *)job->out + i * job->out_stride + job->out_col);
	}
}

static void to_colour(float *y, size_t count, bool sigmoid)
{
	for (size_t i = 0; i < count; i++)
		y[i] = sigmoid ? (float)(1 / (1 + exp(-(double)y[i]))) : 0.5f + 0.5f * y[i];
}
