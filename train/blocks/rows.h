/* Row-wise parts of a block: LayerNorm, forward and backward. */
#pragma once

#include <math.h>

#include "vector.h"

/* Normalise rows of x: unit (bf16, before the weight) and 1/sigma. */
static inline void norm_rows(const float *x, int rows, int dim, float eps, uint16_t *unit,
			     float *rstd)
{
	for (int r = 0; r < rows; r++, x += dim, unit += dim) {
		__m512 sum = _mm512_setzero_ps(), squares = sum;
		for (int i = 0; i < dim; i += 16) {
			sum = _mm512_add_ps(sum, _mm512_loadu_ps(x + i));
		}
		__m512 mean = _mm512_set1_ps(_mm512_reduce_add_ps(sum) / (float)dim);
		for (int i = 0; i < dim; i += 16) {
			__m512 d = _mm512_sub_ps(_mm512_loadu_ps(x + i), mean);
			squares = _mm512_fmadd_ps(d, d, squares);
		}
		rstd[r] = 1.0f / sqrtf(_mm512_reduce_add_ps(squares) / (float)dim + eps);
		__m512 scale = _mm512_set1_ps(rstd[r]);
		for (int i = 0; i < dim; i += 32) {
			store_bf16(
				unit + i,
				_mm512_mul_ps(_mm512_sub_ps(_mm512_loadu_ps(x + i), mean), scale),
				_mm512_mul_ps(_mm512_sub_ps(_mm512_loadu_ps(x + i + 16), mean),
					      scale));
		}
	}
}

/* rows of unit x weight */
static inline void weigh_rows(const uint16_t *unit, int rows, int dim, const float *weight,
			      uint16_t *out)
{
	for (int r = 0; r < rows; r++) {
		for (int i = 0; i < dim; i += 32, unit += 32, out += 32) {
			store_bf16(out, _mm512_mul_ps(load_bf16(unit), _mm512_loadu_ps(weight + i)),
				   _mm512_mul_ps(load_bf16(unit + 16),
						 _mm512_loadu_ps(weight + i + 16)));
		}
	}
}

/* Through the norm: dx += its gradient, weight_gradient += ... for the gradient dy of its output.
 */
static inline void norm_rows_back(const float *dy, const uint16_t *unit, const float *rstd,
				  int rows, int dim, const float *weight, float *weight_gradient,
				  float *dx)
{
	for (int r = 0; r < rows; r++, dy += dim, unit += dim, dx += dim) {
		__m512 sum = _mm512_setzero_ps(), along = sum;
		for (int i = 0; i < dim; i += 16) {
			__m512 u = load_bf16(unit + i), g = _mm512_loadu_ps(dy + i);
			_mm512_storeu_ps(
				weight_gradient + i,
				_mm512_fmadd_ps(g, u, _mm512_loadu_ps(weight_gradient + i)));
			g = _mm512_mul_ps(g, _mm512_loadu_ps(weight + i));
			sum = _mm512_add_ps(sum, g);
			along = _mm512_fmadd_ps(g, u, along);
		}
		__m512 mean = _mm512_set1_ps(_mm512_reduce_add_ps(sum) / (float)dim);
		__m512 mean_along = _mm512_set1_ps(_mm512_reduce_add_ps(along) / (float)dim);
		__m512 scale = _mm512_set1_ps(rstd[r]);
		for (int i = 0; i < dim; i += 16) {
			__m512 g =
				_mm512_mul_ps(_mm512_loadu_ps(dy + i), _mm512_loadu_ps(weight + i));
			g = _mm512_sub_ps(g,
					  _mm512_fmadd_ps(load_bf16(unit + i), mean_along, mean));
			_mm512_storeu_ps(dx + i,
					 _mm512_fmadd_ps(g, scale, _mm512_loadu_ps(dx + i)));
		}
	}
}
