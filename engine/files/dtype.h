/* Number types of a safetensors file. Private to the engine. */
#ifndef DVSM_FILES_DTYPE_H
#define DVSM_FILES_DTYPE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum dvsm_dtype {
	DVSM_DTYPE_BOOL,
	DVSM_DTYPE_U8,
	DVSM_DTYPE_I8,
	DVSM_DTYPE_F8_E5M2,
	DVSM_DTYPE_F8_E4M3,
	DVSM_DTYPE_I16,
	DVSM_DTYPE_U16,
	DVSM_DTYPE_F16,
	DVSM_DTYPE_BF16,
	DVSM_DTYPE_I32,
	DVSM_DTYPE_U32,
	DVSM_DTYPE_F32,
	DVSM_DTYPE_F64,
	DVSM_DTYPE_I64,
	DVSM_DTYPE_U64,
};

/** The type of a name as the file writes it ("BF16"); false when there is none. */
bool dvsm_dtype_parse(const char *name, enum dvsm_dtype *dtype);
const char *dvsm_dtype_name(enum dvsm_dtype dtype);
size_t dvsm_dtype_bytes(enum dvsm_dtype dtype);

/** F32, F16 or BF16: what dvsm_dtype_expand() turns into float exactly. */
bool dvsm_dtype_is_weight(enum dvsm_dtype dtype);

/** Index of the first NaN or infinity among `count` numbers, `count` when there is none. */
size_t dvsm_dtype_find_non_finite(enum dvsm_dtype dtype, const void *numbers, size_t count);

/** Largest magnitude among `count` finite numbers of F32, F16 or BF16; 0 when there are none. */
float dvsm_dtype_find_largest(enum dvsm_dtype dtype, const void *numbers, size_t count);

/** F32, F16 or BF16 to float. */
void dvsm_dtype_expand(enum dvsm_dtype dtype, const void *numbers, size_t count, float *out);

#endif
