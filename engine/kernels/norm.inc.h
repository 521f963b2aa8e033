/*
 * Template: LayerNorm, RMS norm and conversion, to floats and to numbers. Included once by each
 * tier, after its number_<precision>.inc.h.
 */

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

/* Lanes `at` and on of a row of floats or of numbers. */
DVSM_INLINE void put(void *out, size_t at, vf a, bool floats)
{
	if (floats)
		vf_store((float *)out + at, a);
	else
		num_store((number *)out + at, a);
}

DVSM_INLINE void put_part(void *out, size_t at, vf a, size_t n, bool floats)
{
	if (floats)
		vf_store_part((float *)out + at, a, n);
	else
		num_store_part((number *)out + at, a, n);
}

/* out = (x - shift) factor weight, from number `at` of out on */
DVSM_INLINE void write_scaled(const float *x, size_t dim, float shift, float factor,
			      const float *weight, void *out, size_t at, bool floats)
{
	vf centre = vf_set(shift), scale = vf_set(factor);
	size_t d = 0;

	for (; d + VF_LANES <= dim; d += VF_LANES) {
		vf e = vf_mul(vf_sub(vf_load(x + d), centre), scale);

		put(out, at + d, vf_mul(e, vf_load(weight + d)), floats);
	}
	if (d < dim) {
		vf e = vf_mul(vf_sub(vf_load_part(x + d, dim - d), centre), scale);

		put_part(out, at + d, vf_mul(e, vf_load_part(weight + d, dim - d)), dim - d,
			 floats);
	}
}

DVSM_INLINE void layer_norm_to(const float *x, size_t rows, size_t dim, const float *weight,
			       float eps, void *out, bool floats)
{
	for (size_t i = 0; i < rows; i++, x += dim) {
		float mean = sum_of(x, dim) / (float)dim;
		float variance = squares_of(x, dim, mean) / (float)dim;

		write_scaled(x, dim, mean, 1.0f / sqrtf(variance + eps), weight, out, i * dim,
			     floats);
	}
}

DVSM_INLINE void rms_norm_to(const float *x, size_t x_stride, size_t rows, size_t dim,
			     const float *weight, float eps, void *out, size_t out_stride,
			     bool floats)
{
	for (size_t i = 0; i < rows; i++, x += x_stride) {
		float mean_square = squares_of(x, dim, 0.0f) / (float)dim;

		write_scaled(x, dim, 0.0f, 1.0f / sqrtf(mean_square + eps), weight, out,
			     i * out_stride, floats);
	}
}

static void embed_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       void *out)
{
	layer_norm_to(x, rows, dim, weight, eps, out, true);
}

static void query_norm(const float *x, size_t x_stride, size_t rows, size_t dim,
		       const float *weight, float eps, void *out, size_t out_stride)
{
	rms_norm_to(x, x_stride, rows, dim, weight, eps, out, out_stride, true);
}

static void layer_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       void *out)
{
	layer_norm_to(x, rows, dim, weight, eps, out, NUMBER_IS_FLOAT);
}

static void key_norm(const float *x, size_t x_stride, size_t rows, size_t dim, const float *weight,
		     float eps, void *out, size_t out_stride)
{
	rms_norm_to(x, x_stride, rows, dim, weight, eps, out, out_stride, NUMBER_IS_FLOAT);
}

static void convert(const float *x, size_t x_stride, size_t rows, size_t dim, void *out,
		    size_t out_stride)
{
	number *to = out;

	for (size_t i = 0; i < rows; i++, x += x_stride, to += out_stride) {
		size_t d = 0;

		for (; d + VF_LANES <= dim; d += VF_LANES)
			num_store(to + d, vf_load(x + d));
		if (d < dim)
			num_store_part(to + d, vf_load_part(x + d, dim - d), dim - d);
	}
}
