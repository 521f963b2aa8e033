/*
 * Fixed-point attention, and the keys and values that are packed for it: every tier against the
 * scalar specification, bit for bit, and the specification's weights against powers of two.
 */
#include <math.h>
#include <stdlib.h>

#include "fixed_checks.h"

static void check_pack(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), dim = edge(1), stride = dim + (size_t)between(0, 9);
	struct dvsm_fixed_channel *channels = take(dim * sizeof(*channels));
	struct dvsm_fixed_pack job = {
		.x = take_s16(rows, stride, dim),
		.x_stride = stride,
		.rows = rows,
		.dim = dim,
		.head_width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD),
		.channels = channels,
		.first = edge(0),
	};
	size_t padded = dvsm_fixed_pad(job.first + rows, DVSM_FIXED_KEY_PAD);
	struct outputs keys = take_outputs(padded * job.head_width);
	struct outputs values = take_outputs(padded * job.head_width);

	for (size_t d = 0; d < dim; d++) {
		struct dvsm_fixed_fit fit =
			dvsm_fixed_fit_make((uint32_t)abs(draw(15, draw_kind())));

		channels[d] = (struct dvsm_fixed_channel){(int16_t)draw(15, STEEP),
							  (int16_t)fit.shift, fit.inverse};
	}
	job.packed = keys.want;
	dvsm_fixed_kernels_scalar.pack_keys(&job);
	job.packed = keys.got;
	tier->pack_keys(&job);
	compare(&keys, tier->name, "pack_keys");
	job.packed = values.want;
	dvsm_fixed_kernels_scalar.pack_values(&job);
	job.packed = values.got;
	tier->pack_values(&job);
	compare(&values, tier->name, "pack_values");
}

/* Packed keys or values: zeros behind the last key, and behind the last channel; behind all keys
 * anything. */
static int8_t *take_packed(const struct dvsm_fixed_attention *job, bool keys)
{
	size_t padded = dvsm_fixed_pad(job->keys, DVSM_FIXED_KEY_PAD), unit = keys ? 16 : 4;
	const size_t width = keys ? job->key_width : job->head_width;
	const size_t numbers = width == job->head_width ? job->dim : width;
	const size_t bytes = padded * width, behind = keys ? DVSM_FIXED_BEHIND_KEYS : 0;
	int8_t *made = take(bytes + behind);
	enum kind kind = draw_kind();

	memset(made, 0, bytes);
	for (size_t i = 0; i < behind; i++)
		made[bytes + i] = (int8_t)draw(7, kind);
	for (size_t key = 0; key < job->keys; key++) {
		int8_t *to = made + key / unit * unit * width;
		/* Keys that are alike, as neighbours are, and now and then one that stands out. */
		int bits = between(0, 30) ? between(3, 6) : 7;

		for (size_t d = 0; d < numbers; d++)
			to[keys ? d / 4 * 64 + key % 16 * 4 + d % 4 : d * 4 + key % 4] =
				(int8_t)draw(kind == EXTREME ? 7 : bits, kind);
	}
	return made;
}

static void check_attention(const struct dvsm_fixed_kernels *tier)
{
	size_t dim = edge(1), width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD);
	const bool planes = between(0, 1);
	const size_t key_width = planes ? 2 * dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH) : width;
	struct dvsm_fixed_scale *scales, *v_scales = take(dim * sizeof(*v_scales));
	int16_t *means = take(dim * sizeof(*means));
	struct dvsm_fixed_attention job = {
		.q_stride = key_width * (size_t)between(1, 3),
		.scale_stride = (size_t)between(1, 3),
		.queries = edge(0) % (tier->attention_queries + 1),
		.keys = edge(0) + (between(0, 1) ? 0 : 256 * (size_t)between(0, 5)) +
			(between(0, 60) ? 0 : 8192),
		.dim = dim,
		.head_width = width,
		.key_width = key_width,
		.v_scale = v_scales,
		.v_mean = means,
		.out_stride = dim + (size_t)between(0, 9),
	};
	int8_t *q = take(job.queries ? (job.queries - 1) * job.q_stride + key_width : 0);
	int low = between(-46, -10), high = low + between(0, 8);

	scales = take(job.queries ? ((job.queries - 1) * job.scale_stride + 1) * sizeof(*scales)
				  : 0);
	for (size_t i = 0; i < job.queries; i++) {
		enum kind kind = draw_kind();

		for (size_t d = 0; d < key_width; d++)
			q[i * job.q_stride + d] = (int8_t)(planes || d < dim ? draw(7, kind) : 0);
		scales[i * job.scale_stride] =
			kind == ZERO ? (struct dvsm_fixed_scale){0, 0} : draw_scale(low, high);
	}
	for (size_t d = 0; d < dim; d++) {
		v_scales[d] =
			between(0, 20) ? draw_scale(-16, -4) : (struct dvsm_fixed_scale){0, 0};
		means[d] = (int16_t)draw(15, STEEP);
	}
	job.q = q;
	job.q_scale = scales;
	job.k = take_packed(&job, true);
	job.v = take_packed(&job, false);
	job.scratch = take(dvsm_fixed_pad(dvsm_fixed_attention_scratch(width), 64));

	struct outputs out = take_outputs(
		job.queries ? ((job.queries - 1) * job.out_stride + dim) * sizeof(int16_t) : 0);

	job.out = out.want;
	dvsm_fixed_kernels_scalar.attention(&job);
	job.out = out.got;
	tier->attention(&job);
	compare(&out, tier->name, "attention");
}

EXACT(pack, 200)
EXACT(attention, 300)

static void every_score_becomes_a_word(void **state)
{
	(void)state;
	for (int round = 0; round < 2000; round++) {
		const size_t width = DVSM_FIXED_HEAD * (size_t)between(1, 16);
		const enum kind kind = draw_kind();
		int8_t q[16 * DVSM_FIXED_HEAD];
		int64_t most = 0;

		for (size_t d = 0; d < width; d++) {
			q[d] = (int8_t)draw(7, kind);
			most += 128 * abs(q[d]);
		}

		const int shift = dvsm_fixed_score_shift(q, width);

		assert_true(most >> shift <= INT16_MAX && -most >> shift >= INT16_MIN);
		assert_true(shift == 0 || most >> (shift - 1) > INT16_MAX - 128);
	}
}

/* From the top down to where nothing is left, a step of a word being half a power at most. */
static void weights_follow_powers_of_two_however_far_a_score_is(void **state)
{
	(void)state;
	for (int round = 0; round < 20000; round++) {
		const struct dvsm_fixed_scale scale = draw_scale(-40, -20);
		const int shift = between(0, 7);
		const struct dvsm_fixed_slope slope = dvsm_fixed_slope_make(scale, shift);
		const double step = ldexp(scale.mantissa, scale.exponent + shift);
		const uint32_t way = (uint32_t)fmin(between(0, 2000) * 0.01 / step, 65535);
		const double p = dvsm_fixed_exp2(way * slope.factor >> 16, slope.fraction);
		/* What factor and x round; the polynomial; half a unit of p. */
		const double want = 23150 * exp2(-(way * step));
		const double most = 0.6 + want * (exp2(ldexp(2, -slope.fraction)) - 1 + 2e-4);

		if (step <= 0.5 && fabs(p - want) > most)
			fail_msg("%u steps of %d 2^%d, shift %d: weight %g, not %g", way,
				 scale.mantissa, scale.exponent, shift, p, want);
	}
}

static int set_up(void **state)
{
	(void)state;
	return find_tiers("test_fixed_attention");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_score_becomes_a_word),
		cmocka_unit_test(weights_follow_powers_of_two_however_far_a_score_is),
		cmocka_unit_test(pack_is_exact_in_every_tier),
		cmocka_unit_test(attention_is_exact_in_every_tier),
	};

	return cmocka_run_group_tests(tests, set_up, NULL);
}
