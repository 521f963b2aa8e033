/*
 * Safetensors files: 8 bytes of header length, a JSON header, the tensors' bytes without gaps
 * (https://github.com/huggingface/safetensors#format). Private to the engine.
 *
 * Reading goes in two steps: open checks the header against the file in every respect and reads no
 * tensor; load then passes over the tensors once, in file order, so that a model of any size needs
 * no second copy of itself in memory.
 */
#ifndef DVSM_FILES_SAFETENSORS_H
#define DVSM_FILES_SAFETENSORS_H

#include <stddef.h>
#include <stdint.h>

#include "dvsm/status.h"
#include "files/dtype.h"
#include "files/json.h"
#include "files/sha256.h"
#include "files/source.h"

#define DVSM_TENSOR_MAX_RANK 8

struct dvsm_tensor;

/**
 * Put `count` numbers, of which the first is number `first` of the tensor, behind its destination.
 * Load calls it for F32, F16 and BF16, with every number once and in order.
 */
typedef void dvsm_tensor_place_fn(const struct dvsm_tensor *tensor, size_t first,
				  const float *numbers, size_t count);

struct dvsm_tensor {
	const char *name;
	enum dvsm_dtype dtype;
	uint32_t rank;
	uint64_t shape[DVSM_TENSOR_MAX_RANK];
	size_t count;      /* numbers in it */
	size_t begin, end; /* bytes from the end of the header */
	float largest;     /* magnitude among its numbers, known after load; F32, F16 and BF16 */
	/*
	 * Where load puts the numbers, or NULL to check them only: float for F32, F16 and BF16, the
	 * bytes as they are for every other type.
	 */
	void *destination;
	dvsm_tensor_place_fn *place; /* NULL: as they lie in the file */
	/*
	 * NULL, or [shape[0]] factors that make weights of an I8 tensor of rank 2: load multiplies
	 * and places them as it does floats. They may be another tensor's destination if that one
	 * comes before this one in the file.
	 */
	const float *row_scale;
};

struct dvsm_safetensors {
	struct dvsm_source source;
	struct dvsm_sha256 file_hash; /* of the bytes read so far */
	struct dvsm_json json;
	struct dvsm_tensor *tensors;  /* [count], in file order */
	struct dvsm_tensor **by_name; /* [count], sorted */
	size_t count;
	size_t data_at; /* byte of the source at which the tensors begin */
};

/**
 * Open a file and check its header: every tensor has a known type and a shape that fits its bytes;
 * together they cover the rest of the file without gap or overlap.
 *
 * path   borrowed until close, as `name` and `bytes` below
 *
 * DVSM_IO        cannot be opened or read
 * DVSM_BAD_FILE  malformed; the text names the tensor
 */
enum dvsm_status dvsm_safetensors_open(const char *path, struct dvsm_safetensors *file,
				       struct dvsm_error *error);
enum dvsm_status dvsm_safetensors_open_bytes(const void *bytes, size_t size, const char *name,
					     struct dvsm_safetensors *file,
					     struct dvsm_error *error);
void dvsm_safetensors_close(struct dvsm_safetensors *file);

/** Text of a key of `__metadata__`, or NULL; owned by the file. */
const char *dvsm_safetensors_get_metadata(const struct dvsm_safetensors *file, const char *key);

/** A tensor by name, or NULL; owned by the file. */
struct dvsm_tensor *dvsm_safetensors_find(const struct dvsm_safetensors *file, const char *name);

/**
 * Find a tensor and check its shape. NULL `dtypes` take F32, F16 and BF16.
 *
 * DVSM_BAD_FILE  missing, another shape, another type; the text says which is expected
 */
enum dvsm_status dvsm_safetensors_require(const struct dvsm_safetensors *file, const char *name,
					  const enum dvsm_dtype *dtype, uint32_t rank,
					  const uint64_t *shape, struct dvsm_tensor **tensor,
					  struct dvsm_error *error);

/**
 * Read all tensors into their destinations; once per open.
 *
 * data_hash  NULL, or updated with the tensors' bytes
 * file_hex   NULL, or receives the SHA-256 of the whole file
 *
 * DVSM_BAD_FILE  a NaN or an infinity, in whatever tensor; the text names it
 */
enum dvsm_status dvsm_safetensors_load(struct dvsm_safetensors *file, struct dvsm_sha256 *data_hash,
				       char file_hex[DVSM_SHA256_HEX], struct dvsm_error *error);

/** What dvsm_safetensors_read_part() reads; numbers[count], `first` counted from the part's own. */
typedef void dvsm_tensor_part_fn(void *context, size_t first, const float *numbers, size_t count);

/**
 * Read numbers first .. first + count - 1 of a weight tensor once more, behind load.
 *
 * DVSM_IO  also when the file changed after it was opened: its hash would be another file's
 */
enum dvsm_status dvsm_safetensors_read_part(struct dvsm_safetensors *file,
					    const struct dvsm_tensor *tensor, size_t first,
					    size_t count, dvsm_tensor_part_fn *take, void *context,
					    struct dvsm_error *error);

/** One key of `__metadata__` to write. */
struct dvsm_metadata_out {
	const char *key, *value;
};

/** One tensor to write. */
struct dvsm_tensor_out {
	const char *name;
	enum dvsm_dtype dtype;
	uint32_t rank;
	uint64_t shape[DVSM_TENSOR_MAX_RANK];
	const void *bytes;
	size_t size; /* bytes */
};

/**
 * Write a file beside `path`, sync it and rename it into place, so that a crash leaves the old file
 * or the new one. What was written is removed when anything fails. Tensors stand in the order
 * given; give the wider types first and each is aligned to its numbers.
 *
 * DVSM_IO  the system refused: the text says what and why
 */
enum dvsm_status dvsm_safetensors_write(const char *path, const struct dvsm_metadata_out *metadata,
					size_t metadata_count,
					const struct dvsm_tensor_out *tensors, size_t tensor_count,
					struct dvsm_error *error);

#endif
