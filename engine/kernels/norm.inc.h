/*
 * Template: LayerNorm, RMS norm and conversion, to floats and to numbers. Included once by each
 * tier, after its number_<precision>.inc.h; a tier whose left sides are tiled defines LEFT_TILED
 * as true first.
 */

#if !defined(LEFT_TILED)
#define LEFT_TILED false
#endif

/* Number [row][d] of a left side; a vector of numbers lies in one piece from a multiple of its
 * length on. */
DVSM_INLINE size_t left_at(size_t row, size_t d, size_t stride)
{
	return LEFT_TILED ? dvsm_tile_place(row, d, stride) : row * stride + d;
}

/* Sums in turn, so that none waits for the one before. */
#define SUMS 4

static inline float total_of(const vf sums[SUMS])
{
	return vf_sum(vf_add(vf_add(sums[0], sums[1]), vf_add(sums[2], sums[3])));
}

static inline float sum_of(const float *x, size_t dim)
{
	vf sums[SUMS] = {vf_set(0.0f), vf_set(0.0f), vf_set(0.0f), vf_set(0.0f)};
	size_t d = 0;

	for (; d + SUMS * VF_LANES <= dim; d += SUMS * VF_LANES) {
		DVSM_UNROLL
		for (int i = 0; i < SUMS; i++)
			sums[i] = vf_add(sums[i], vf_load(x + d + (size_t)i * VF_LANES));
	}
	for (; d + VF_LANES <= dim; d += VF_LANES)
		sums[0] = vf_add(sums[0], vf_load(x + d));
	if (d < dim)
		sums[1] = vf_add(sums[1], vf_load_part(x + d, dim - d));
	return total_of(sums);
}

static inline vf add_square(vf sum, const float *x, vf centre)
{
	vf e = vf_sub(vf_load(x), centre);

	return vf_fma(e, e, sum);
}

/* Of x - shift; the lanes past the end must not add shift^2, so the last few go one by one. */
static inline float squares_of(const float *x, size_t dim, float shift)
{
	vf sums[SUMS] = {vf_set(0.0f), vf_set(0.0f), vf_set(0.0f), vf_set(0.0f)};
	vf centre = vf_set(shift);
	float rest = 0.0f;
	size_t d = 0;

	for (; d + SUMS * VF_LANES <= dim; d += SUMS * VF_LANES) {
		DVSM_UNROLL
		for (int i = 0; i < SUMS; i++)
			sums[i] = add_square(sums[i], x + d + (size_t)i * VF_LANES, centre);
	}
	for (; d + VF_LANES <= dim; d += VF_LANES)
		sums[0] = add_square(sums[0], x + d, centre);
	for (; d < dim; d++)
		rest += (x[d] - shift) * (x[d] - shift);
	return total_of(sums) + rest;
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

/* Where a row goes: floats or numbers [row][stride], or a left side. */
enum place { PLACE_FLOATS, PLACE_NUMBERS, PLACE_LEFT };

#define PLACE_KEYS (NUMBER_IS_FLOAT ? PLACE_FLOATS : PLACE_NUMBERS)

/* Row `row` of out = (x - shift) factor weight */
DVSM_INLINE void write_scaled(const float *x, size_t dim, float shift, float factor,
			      const float *weight, void *out, size_t row, size_t stride,
			      enum place place)
{
	const bool floats = place == PLACE_FLOATS || (place == PLACE_LEFT && NUMBER_IS_FLOAT);
	vf centre = vf_set(shift), scale = vf_set(factor);
	size_t d = 0;

	for (; d + VF_LANES <= dim; d += VF_LANES) {
		vf e = vf_mul(vf_sub(vf_load(x + d), centre), scale);

		put(out, place == PLACE_LEFT ? left_at(row, d, stride) : row * stride + d,
		    vf_mul(e, vf_load(weight + d)), floats);
	}
	if (d < dim) {
		vf e = vf_mul(vf_sub(vf_load_part(x + d, dim - d), centre), scale);

		put_part(out, place == PLACE_LEFT ? left_at(row, d, stride) : row * stride + d,
			 vf_mul(e, vf_load_part(weight + d, dim - d)), dim - d, floats);
	}
}

DVSM_INLINE void layer_norm_to(const float *x, size_t rows, size_t dim, const float *weight,
			       float eps, void *out, enum place place)
{
	for (size_t i = 0; i < rows; i++, x += dim) {
		float mean = sum_of(x, dim) / (float)dim;
		float variance = squares_of(x, dim, mean) / (float)dim;

		write_scaled(x, dim, mean, 1.0f / sqrtf(variance + eps), weight, out, i, dim,
			     place);
	}
}

DVSM_INLINE void rms_norm_to(const float *x, size_t x_stride, size_t rows, size_t dim,
			     const float *weight, float eps, void *out, size_t out_stride,
			     enum place place)
{
	for (size_t i = 0; i < rows; i++, x += x_stride) {
		float mean_square = squares_of(x, dim, 0.0f) / (float)dim;

		write_scaled(x, dim, 0.0f, 1.0f / sqrtf(mean_square + eps), weight, out, i,
			     out_stride, place);
	}
}

static void embed_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       void *out)
{
	layer_norm_to(x, rows, dim, weight, eps, out, PLACE_FLOATS);
}

static void query_norm(const float *x, size_t x_stride, size_t rows, size_t dim,
		       const float *weight, float eps, void *out, size_t out_stride)
{
	rms_norm_to(x, x_stride, rows, dim, weight, eps, out, out_stride, PLACE_FLOATS);
}

static void layer_norm(const float *x, size_t rows, size_t dim, const float *weight, float eps,
		       void *out)
{
	layer_norm_to(x, rows, dim, weight, eps, out, PLACE_LEFT);
}

static void key_norm(const float *x, size_t x_stride, size_t rows, size_t dim, const float *weight,
		     float eps, void *out, size_t out_stride)
{
	rms_norm_to(x, x_stride, rows, dim, weight, eps, out, out_stride, PLACE_KEYS);
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

static void left(const float *x, size_t x_stride, size_t rows, size_t dim, void *out,
		 size_t out_stride, size_t out_col)
{
	number *to = out;

	if (!LEFT_TILED) {
		convert(x, x_stride, rows, dim, to + out_col, out_stride);
		return;
	}
	for (size_t i = 0; i < rows; i++, x += x_stride) {
		size_t d = 0;

		for (; out_col % VF_LANES == 0 && d + VF_LANES <= dim; d += VF_LANES)
			num_store(to + left_at(i, out_col + d, out_stride), vf_load(x + d));
		for (; d < dim; d++)
			num_store_part(to + left_at(i, out_col + d, out_stride),
				       vf_load_part(x + d, 1), 1);
	}
}
