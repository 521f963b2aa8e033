/* Template: LayerNorm and RMS norm. Included once by each f32_<tier>.c, after f32_math.inc.h. */

static inline float sum_of(const float *x, size_t dim)
{
	vf sum = vf_set(0.0f);
	size_t d = 0;

	for (; d + VF_LANES <= dim; d += VF_LANES)
		sum = vf_add(sum, vf_load(x + d));
	if (d < dim)
		sum = vf_add(sum, vf_load_part(x + d, dim - d));
	return vf_sum(sum);
}

/* Of x - shift; the lanes past the end must not add shift^2, so the last few go one by one. */
static inline float squares_of(const float *x, size_t dim, float shift)
{
	vf sum = vf_set(0.0f), centre = vf_set(shift);
	float rest = 0.0f;
	size_t d = 0;

	for (; d + VF_LANES <= dim; d += VF_LANES) {
		vf e = vf_sub(vf_load(x + d), centre);

		sum = vf_fma(e, e, sum);
	}
	for (; d < dim; d++)
		rest += (x[d] - shift) * (x[d] - shift);
	return vf_sum(sum) + rest;
}

/* out = (x - shift) factor weight */
static inline void write_scaled(const float *x, size_t dim, float shift, float factor,
				const float *weight, float *out)
{
	vf centre = vf_set(shift), scale = vf_set(factor);
	size_t d = 0;

	for (; d + VF_LANES <= dim; d += VF_LANES) {
		vf e = vf_mul(vf_sub(vf_load(x + d), centre), scale);

		vf_store(out + d, vf_mul(e, vf_load(weight + d)));
	}
	if (d < dim) {
		vf e = vf_mul(vf_sub(vf_load_part(x + d, dim - d), centre), scale);

		vf_store_part(out + d, vf_mul(e, vf_load_part(weight + d, dim - d)), dim - d);
	}
}

static void layer_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       float *out)
{
	for (size_t i = 0; i < rows; i++, x += dim, out += dim) {
		float mean = sum_of(x, dim) / (float)dim;
		float variance = squares_of(x, dim, mean) / (float)dim;

		write_scaled(x, dim, mean, 1.0f / sqrtf(variance + eps), weight, out);
	}
}

static void rms_norm(const float *x, size_t x_stride, size_t rows, size_t dim, const float *weight,
		     float eps, float *out, size_t out_stride)
{
	for (size_t i = 0; i < rows; i++, x += x_stride, out += out_stride) {
		float mean_square = squares_of(x, dim, 0.0f) / (float)dim;

		write_scaled(x, dim, 0.0f, 1.0f / sqrtf(mean_square + eps), weight, out);
	}
}
