#include "files/dtype.h"

#include <string.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "safetensors are little-endian and are read as they lie: a big-endian CPU is not supported"
#endif

static const struct {
	const char *name;
	unsigned char bytes;
} types[] = {
	[DVSM_DTYPE_BOOL] = {"BOOL", 1},       [DVSM_DTYPE_U8] = {"U8", 1},
	[DVSM_DTYPE_I8] = {"I8", 1},           [DVSM_DTYPE_F8_E5M2] = {"F8_E5M2", 1},
	[DVSM_DTYPE_F8_E4M3] = {"F8_E4M3", 1}, [DVSM_DTYPE_I16] = {"I16", 2},
	[DVSM_DTYPE_U16] = {"U16", 2},         [DVSM_DTYPE_F16] = {"F16", 2},
	[DVSM_DTYPE_BF16] = {"BF16", 2},       [DVSM_DTYPE_I32] = {"I32", 4},
	[DVSM_DTYPE_U32] = {"U32", 4},         [DVSM_DTYPE_F32] = {"F32", 4},
	[DVSM_DTYPE_F64] = {"F64", 8},         [DVSM_DTYPE_I64] = {"I64", 8},
	[DVSM_DTYPE_U64] = {"U64", 8},
};

bool dvsm_dtype_parse(const char *name, enum dvsm_dtype *dtype)
{
	for (size_t i = 0; i < sizeof(types) / sizeof(types[0]); i++) {
		if (strcmp(types[i].name, name) == 0) {
			*dtype = (enum dvsm_dtype)i;
			return true;
		}
	}
	return false;
}

const char *dvsm_dtype_name(enum dvsm_dtype dtype)
{
	return types[dtype].name;
}

size_t dvsm_dtype_bytes(enum dvsm_dtype dtype)
{
	return types[dtype].bytes;
}

bool dvsm_dtype_is_weight(enum dvsm_dtype dtype)
{
	return dtype == DVSM_DTYPE_F32 || dtype == DVSM_DTYPE_F16 || dtype == DVSM_DTYPE_BF16;
}

/* Exponent bits of a floating type at the top of its 8-byte image, 0 when it has no infinity. */
static uint64_t exponent_mask(enum dvsm_dtype dtype)
{
	switch (dtype) {
	case DVSM_DTYPE_F16:
		return 0x7c00;
	case DVSM_DTYPE_BF16:
		return 0x7f80;
	case DVSM_DTYPE_F32:
		return 0x7f800000;
	case DVSM_DTYPE_F64:
		return 0x7ff0000000000000;
	default:
		return 0;
	}
}

size_t dvsm_dtype_find_non_finite(enum dvsm_dtype dtype, const void *numbers, size_t count)
{
	uint64_t mask = exponent_mask(dtype);
	if (mask == 0)
		return count;

	size_t bytes = dvsm_dtype_bytes(dtype);
	const unsigned char *from = numbers;
	for (size_t i = 0; i < count; i++) {
		uint64_t image = 0;
		memcpy(&image, from + i * bytes, bytes);
		if ((image & mask) == mask)
			return i;
	}
	return count;
}

static float float_of(uint32_t image)
{
	float value;
	memcpy(&value, &image, sizeof(value));
	return value;
}

static float half_to_float(uint16_t half)
{
	uint32_t sign = (uint32_t)(half & 0x8000) << 16;
	uint32_t exponent = half >> 10 & 0x1f;
	uint32_t fraction = half & 0x3ff;
	if (exponent == 0) {
		/* Subnormal: fraction 2^-24, exact in float. */
		float magnitude = (float)fraction * 0x1p-24f;
		return sign ? -magnitude : magnitude;
	}
	if (exponent == 0x1f)
		return float_of(sign | 0x7f800000 | fraction << 13);
	return float_of(sign | (exponent + 112) << 23 | fraction << 13);
}

/* Without their sign, the images of finite numbers are in the order of their magnitudes. */
static uint32_t largest_f32(const unsigned char *from, size_t count)
{
	uint32_t largest = 0;
	for (size_t i = 0; i < count; i++) {
		uint32_t image;
		memcpy(&image, from + 4 * i, sizeof(image));
		image &= 0x7fffffff;
		largest = image > largest ? image : largest;
	}
	return largest;
}

static uint16_t largest_16_bits(const unsigned char *from, size_t count)
{
	uint16_t largest = 0;
	for (size_t i = 0; i < count; i++) {
		uint16_t image;
		memcpy(&image, from + 2 * i, sizeof(image));
		image &= 0x7fff;
		largest = image > largest ? image : largest;
	}
	return largest;
}

float dvsm_dtype_find_largest(enum dvsm_dtype dtype, const void *numbers, size_t count)
{
	if (dtype == DVSM_DTYPE_F32)
		return float_of(largest_f32(numbers, count));
	uint16_t image = largest_16_bits(numbers, count);
	return dtype == DVSM_DTYPE_F16 ? half_to_float(image) : float_of((uint32_t)image << 16);
}

void dvsm_dtype_expand(enum dvsm_dtype dtype, const void *numbers, size_t count, float *out)
{
	if (dtype == DVSM_DTYPE_F32) {
		memcpy(out, numbers, count * sizeof(*out));
		return;
	}
	const unsigned char *from = numbers;
	for (size_t i = 0; i < count; i++) {
		uint16_t image;
		memcpy(&image, from + 2 * i, sizeof(image));
		out[i] = dtype == DVSM_DTYPE_F16 ? half_to_float(image)
						 : float_of((uint32_t)image << 16);
	}
}
