#include "files/safetensors.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"

/* Read, hashed and converted at a time; a multiple of every type's size. */
#define CHUNK_BYTES ((size_t)1 << 20)

/* "[3, 4]" into `text`. */
static void print_shape(uint32_t rank, const uint64_t *shape, char *text, size_t size)
{
	size_t used = (size_t)snprintf(text, size, "[");
	for (uint32_t i = 0; i < rank && used < size; i++)
		used += (size_t)snprintf(text + used, size - used, "%s%llu", i ? ", " : "",
					 (unsigned long long)shape[i]);
	if (used < size)
		snprintf(text + used, size - used, "]");
}

enum dvsm_status dvsm_safetensors_require(const struct dvsm_safetensors *file, const char *name,
					  const enum dvsm_dtype *dtype, uint32_t rank,
					  const uint64_t *shape, struct dvsm_tensor **tensor,
					  struct dvsm_error *error)
{
	const char *file_name = dvsm_name_tail(file->source.name);
	struct dvsm_tensor *found = dvsm_safetensors_find(file, name);
	if (!found)
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: tensor %s: is missing", file_name,
				 name);
	if (dtype ? found->dtype != *dtype : !dvsm_dtype_is_weight(found->dtype))
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: tensor %s: is %s, must be %s",
				 file_name, name, dvsm_dtype_name(found->dtype),
				 dtype ? dvsm_dtype_name(*dtype) : "F32, F16 or BF16");
	if (found->rank != rank || memcmp(found->shape, shape, rank * sizeof(*shape)) != 0) {
		char is[100], expected[100];
		print_shape(found->rank, found->shape, is, sizeof(is));
		print_shape(rank, shape, expected, sizeof(expected));
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: tensor %s: shape is %s, must be %s",
				 file_name, name, is, expected);
	}
	*tensor = found;
	return DVSM_OK;
}

/* Numbers expanded at a time on their way to a tensor's own place function. */
#define EXPANDED_FLOATS 4096u

/* Numbers as floats, int8 by the factor of its row. */
static void expand(const struct dvsm_tensor *tensor, size_t first, size_t count,
		   const void *numbers, float *out)
{
	const int8_t *bytes = numbers;
	if (!tensor->row_scale) {
		dvsm_dtype_expand(tensor->dtype, numbers, count, out);
		return;
	}
	for (size_t i = 0; i < count; i++)
		out[i] = bytes[i] * tensor->row_scale[(first + i) / (size_t)tensor->shape[1]];
}

static void place_expanded(struct dvsm_tensor *tensor, size_t first, size_t count,
			   const unsigned char *numbers)
{
	float expanded[EXPANDED_FLOATS];
	size_t bytes = dvsm_dtype_bytes(tensor->dtype);
	while (count > 0) {
		size_t step = count < EXPANDED_FLOATS ? count : EXPANDED_FLOATS;
		expand(tensor, first, step, numbers, expanded);
		for (size_t i = 0; tensor->row_scale && i < step; i++) {
			float size = expanded[i] < 0 ? -expanded[i] : expanded[i];
			tensor->largest = size > tensor->largest ? size : tensor->largest;
		}
		if (tensor->destination)
			tensor->place(tensor, first, expanded, step);
		numbers += step * bytes;
		first += step;
		count -= step;
	}
}

/* Check and place `count` numbers that begin at number `first` of the tensor. */
static enum dvsm_status place(const struct dvsm_safetensors *file, struct dvsm_tensor *tensor,
			      size_t first, size_t count, const void *numbers,
			      struct dvsm_error *error)
{
	size_t bad = dvsm_dtype_find_non_finite(tensor->dtype, numbers, count);
	if (bad < count)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: tensor %.120s: number %zu is not finite",
				 dvsm_name_tail(file->source.name), tensor->name, first + bad);
	if (dvsm_dtype_is_weight(tensor->dtype)) {
		float largest = dvsm_dtype_find_largest(tensor->dtype, numbers, count);
		tensor->largest = largest > tensor->largest ? largest : tensor->largest;
	}
	if (!tensor->destination && !tensor->row_scale)
		return DVSM_OK;

	size_t bytes = dvsm_dtype_bytes(tensor->dtype);
	if (tensor->row_scale || (dvsm_dtype_is_weight(tensor->dtype) && tensor->place))
		place_expanded(tensor, first, count, numbers);
	else if (dvsm_dtype_is_weight(tensor->dtype))
		dvsm_dtype_expand(tensor->dtype, numbers, count,
				  (float *)tensor->destination + first);
	else
		memcpy((unsigned char *)tensor->destination + first * bytes, numbers,
		       count * bytes);
	return DVSM_OK;
}

static enum dvsm_status load_tensor(struct dvsm_safetensors *file, struct dvsm_tensor *tensor,
				    void *chunk, struct dvsm_sha256 *data_hash, bool hash_file,
				    struct dvsm_error *error)
{
	size_t bytes = dvsm_dtype_bytes(tensor->dtype);
	size_t step = CHUNK_BYTES / bytes;
	for (size_t first = 0; first < tensor->count; first += step) {
		size_t left = tensor->count - first;
		size_t count = left < step ? left : step;
		enum dvsm_status status =
			dvsm_source_read(&file->source, chunk, count * bytes, error);
		if (status != DVSM_OK)
			return status;
		if (hash_file)
			dvsm_sha256_update(&file->file_hash, chunk, count * bytes);
		if (data_hash)
			dvsm_sha256_update(data_hash, chunk, count * bytes);
		status = place(file, tensor, first, count, chunk, error);
		if (status != DVSM_OK)
			return status;
	}
	return DVSM_OK;
}

enum dvsm_status dvsm_safetensors_load(struct dvsm_safetensors *file, struct dvsm_sha256 *data_hash,
				       char file_hex[DVSM_SHA256_HEX], struct dvsm_error *error)
{
	void *chunk = malloc(CHUNK_BYTES);
	if (!chunk)
		return dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to read it",
				 dvsm_name_tail(file->source.name));
	enum dvsm_status status = DVSM_OK;
	for (size_t i = 0; i < file->count && status == DVSM_OK; i++)
		status = load_tensor(file, &file->tensors[i], chunk, data_hash, file_hex != NULL,
				     error);
	if (status == DVSM_OK && file_hex)
		dvsm_sha256_finish(&file->file_hash, file_hex);
	free(chunk);
	return status;
}

/* The numbers of a chunk, expanded, to whoever asked for them. */
static void give(const struct dvsm_tensor *tensor, size_t from, size_t first, size_t count,
		 const unsigned char *numbers, dvsm_tensor_part_fn *take, void *context)
{
	float expanded[EXPANDED_FLOATS];
	const size_t bytes = dvsm_dtype_bytes(tensor->dtype);
	while (count > 0) {
		size_t step = count < EXPANDED_FLOATS ? count : EXPANDED_FLOATS;
		expand(tensor, first, step, numbers, expanded);
		take(context, first - from, expanded, step);
		numbers += step * bytes;
		first += step;
		count -= step;
	}
}

enum dvsm_status dvsm_safetensors_read_part(struct dvsm_safetensors *file,
					    const struct dvsm_tensor *tensor, size_t first,
					    size_t count, dvsm_tensor_part_fn *take, void *context,
					    struct dvsm_error *error)
{
	const size_t bytes = dvsm_dtype_bytes(tensor->dtype), step = CHUNK_BYTES / bytes;
	const char *name = dvsm_name_tail(file->source.name);
	void *chunk = malloc(CHUNK_BYTES);
	if (!chunk)
		return dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to read it", name);
	enum dvsm_status status = dvsm_source_seek(
		&file->source, file->data_at + tensor->begin + first * bytes, error);
	for (size_t at = 0; at < count && status == DVSM_OK; at += step) {
		size_t now = count - at < step ? count - at : step;
		status = dvsm_source_read(&file->source, chunk, now * bytes, error);
		if (status == DVSM_OK)
			give(tensor, first, first + at, now, chunk, take, context);
	}
	free(chunk);
	if (status == DVSM_OK && !dvsm_source_is_unchanged(&file->source))
		return dvsm_fail(error, DVSM_IO, "%s: it changed while being read: open it again",
				 name);
	return status;
}
