#include "files/safetensors.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "base/memory.h"

/* The header's length stands before it as 64 bits. */
#define PREFIX_BYTES 8

/* Longer headers exist in no model; without a limit a length alone could ask for any memory. */
#define MAX_HEADER_BYTES (64u << 20)

static const char *name_of(const struct dvsm_safetensors *file)
{
	return dvsm_name_tail(file->source.name);
}

static enum dvsm_status fail_memory(const struct dvsm_safetensors *file, struct dvsm_error *error)
{
	return dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to read it", name_of(file));
}

static enum dvsm_status fail_tensor(const struct dvsm_safetensors *file, const char *tensor,
				    const char *fault, struct dvsm_error *error)
{
	return dvsm_fail(error, DVSM_BAD_FILE, "%s: tensor %.120s: %s", name_of(file), tensor,
			 fault);
}

static enum dvsm_status read_hashed(struct dvsm_safetensors *file, void *out, size_t size,
				    struct dvsm_error *error)
{
	enum dvsm_status status = dvsm_source_read(&file->source, out, size, error);
	if (status == DVSM_OK)
		dvsm_sha256_update(&file->file_hash, out, size);
	return status;
}

static enum dvsm_status read_header_length(struct dvsm_safetensors *file, size_t *length,
					   struct dvsm_error *error)
{
	size_t size = file->source.size;
	unsigned char prefix[PREFIX_BYTES];
	if (size < PREFIX_BYTES)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: %zu bytes are too few for a safetensors file", name_of(file),
				 size);
	enum dvsm_status status = read_hashed(file, prefix, sizeof(prefix), error);
	if (status != DVSM_OK)
		return status;

	uint64_t stated = 0;
	for (int i = 0; i < PREFIX_BYTES; i++)
		stated |= (uint64_t)prefix[i] << (8 * i);
	if (stated > MAX_HEADER_BYTES)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: a header of %llu bytes is no safetensors header (limit %u)",
				 name_of(file), (unsigned long long)stated, MAX_HEADER_BYTES);
	if (stated > size - PREFIX_BYTES)
		return dvsm_fail(
			error, DVSM_BAD_FILE,
			"%s: the header ends at byte %llu, the file at %zu: it is truncated",
			name_of(file), (unsigned long long)stated + PREFIX_BYTES, size);
	*length = (size_t)stated;
	return DVSM_OK;
}

static enum dvsm_status parse_header(struct dvsm_safetensors *file, size_t length,
				     struct dvsm_error *error)
{
	char *text = malloc(length ? length : 1);
	if (!text)
		return fail_memory(file, error);
	enum dvsm_status status = read_hashed(file, text, length, error);
	if (status == DVSM_OK && (length == 0 || text[0] != '{'))
		status = dvsm_fail(error, DVSM_BAD_FILE, "%s: the header does not begin with {",
				   name_of(file));
	if (status == DVSM_OK) {
		struct dvsm_json_fault fault;
		if (!dvsm_json_init(&file->json, text, length, &fault))
			status = fault.no_memory
					 ? fail_memory(file, error)
					 : dvsm_fail(error, DVSM_BAD_FILE,
						     "%s: the header is not JSON: %s at byte %zu",
						     name_of(file), fault.what,
						     fault.byte + PREFIX_BYTES);
	}
	free(text);
	return status;
}

static enum dvsm_status check_metadata(const struct dvsm_safetensors *file,
				       const struct dvsm_json_value *metadata,
				       struct dvsm_error *error)
{
	if (metadata->type != DVSM_JSON_OBJECT)
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: __metadata__ is not an object",
				 name_of(file));
	const struct dvsm_json_value *member = dvsm_json_first(&file->json, metadata);
	for (; member; member = dvsm_json_next(&file->json, member)) {
		if (member->type != DVSM_JSON_STRING)
			return dvsm_fail(error, DVSM_BAD_FILE,
					 "%s: __metadata__ key %.120s is not a string",
					 name_of(file), member->key);
	}
	return DVSM_OK;
}

/* shape: an array of counts; fills rank, shape and count. */
static const char *parse_shape(const struct dvsm_json *json, const struct dvsm_json_value *shape,
			       struct dvsm_tensor *tensor)
{
	if (!shape)
		return "has no shape";
	if (shape->type != DVSM_JSON_ARRAY)
		return "shape is not an array";
	if (shape->children > DVSM_TENSOR_MAX_RANK)
		return "shape has more than 8 axes";
	tensor->count = 1;
	const struct dvsm_json_value *axis = dvsm_json_first(json, shape);
	for (; axis; axis = dvsm_json_next(json, axis)) {
		if (!axis->is_count)
			return "shape holds something that is no count";
		tensor->shape[tensor->rank++] = axis->count;
		if (axis->count > SIZE_MAX ||
		    !dvsm_size_mul(tensor->count, (size_t)axis->count, &tensor->count))
			return "shape overflows";
	}
	return NULL;
}

static const char *parse_offsets(const struct dvsm_json *json,
				 const struct dvsm_json_value *offsets, struct dvsm_tensor *tensor)
{
	if (!offsets)
		return "has no data_offsets";
	if (offsets->type != DVSM_JSON_ARRAY || offsets->children != 2)
		return "data_offsets is not an array of two";
	const struct dvsm_json_value *begin = dvsm_json_first(json, offsets);
	const struct dvsm_json_value *end = dvsm_json_next(json, begin);
	if (!begin->is_count || !end->is_count || begin->count > SIZE_MAX || end->count > SIZE_MAX)
		return "data_offsets are not two byte counts";
	tensor->begin = (size_t)begin->count;
	tensor->end = (size_t)end->count;
	return tensor->begin > tensor->end ? "data_offsets end before they begin" : NULL;
}

/* One member of the header; NULL or the fault. */
static const char *parse_tensor(const struct dvsm_json *json, const struct dvsm_json_value *member,
				struct dvsm_tensor *tensor)
{
	if (member->type != DVSM_JSON_OBJECT)
		return "is not described by an object";
	if (member->children != 3)
		return "must have dtype, shape and data_offsets, and nothing else";

	const struct dvsm_json_value *dtype = dvsm_json_find(json, member, "dtype");
	if (!dtype)
		return "has no dtype";
	if (dtype->type != DVSM_JSON_STRING || !dvsm_dtype_parse(dtype->text, &tensor->dtype))
		return "dtype is unknown";

	tensor->name = member->key;
	const char *fault = parse_shape(json, dvsm_json_find(json, member, "shape"), tensor);
	if (!fault)
		fault = parse_offsets(json, dvsm_json_find(json, member, "data_offsets"), tensor);
	if (fault)
		return fault;

	size_t bytes;
	if (!dvsm_size_mul(tensor->count, dvsm_dtype_bytes(tensor->dtype), &bytes))
		return "shape overflows";
	return bytes == tensor->end - tensor->begin ? NULL
						    : "data_offsets do not fit shape and dtype";
}

static enum dvsm_status parse_tensors(struct dvsm_safetensors *file, struct dvsm_error *error)
{
	const struct dvsm_json_value *root = &file->json.values[0];
	file->tensors = calloc((size_t)root->children + 1, sizeof(*file->tensors));
	file->by_name = calloc((size_t)root->children + 1, sizeof(struct dvsm_tensor *));
	if (!file->tensors || !file->by_name)
		return fail_memory(file, error);

	const struct dvsm_json_value *member = dvsm_json_first(&file->json, root);
	for (; member; member = dvsm_json_next(&file->json, member)) {
		if (strcmp(member->key, "__metadata__") == 0) {
			enum dvsm_status status = check_metadata(file, member, error);
			if (status != DVSM_OK)
				return status;
			continue;
		}
		const char *fault = parse_tensor(&file->json, member, &file->tensors[file->count]);
		if (fault)
			return fail_tensor(file, member->key, fault, error);
		file->count++;
	}
	return DVSM_OK;
}

static int compare_places(const void *a, const void *b)
{
	const struct dvsm_tensor *left = a, *right = b;
	if (left->begin != right->begin)
		return left->begin < right->begin ? -1 : 1;
	if (left->end != right->end)
		return left->end < right->end ? -1 : 1;
	return strcmp(left->name, right->name);
}

static int compare_names(const void *a, const void *b)
{
	const struct dvsm_tensor *const *left = a, *const *right = b;
	return strcmp((*left)->name, (*right)->name);
}

/* Before gaps are looked for: a tensor far out of range would make its neighbour seem at fault. */
static enum dvsm_status check_range(const struct dvsm_safetensors *file, size_t data_bytes,
				    struct dvsm_error *error)
{
	for (size_t i = 0; i < file->count; i++) {
		const struct dvsm_tensor *tensor = &file->tensors[i];
		if (tensor->end > data_bytes)
			return dvsm_fail(error, DVSM_BAD_FILE,
					 "%s: tensor %.120s: ends at data byte %zu of %zu: "
					 "out of range, or the file is truncated",
					 name_of(file), tensor->name, tensor->end, data_bytes);
	}
	return DVSM_OK;
}

/* Without gap or overlap from the header's end to the file's. */
static enum dvsm_status check_places(struct dvsm_safetensors *file, struct dvsm_error *error)
{
	size_t data_bytes = file->source.size - file->source.position;
	enum dvsm_status status = check_range(file, data_bytes, error);
	file->data_at = file->source.position;
	if (status != DVSM_OK)
		return status;

	size_t end = 0;
	qsort(file->tensors, file->count, sizeof(*file->tensors), compare_places);
	for (size_t i = 0; i < file->count; i++) {
		const struct dvsm_tensor *tensor = &file->tensors[i];
		if (tensor->begin < end)
			return fail_tensor(file, tensor->name, "overlaps the tensor before it",
					   error);
		if (tensor->begin > end)
			return fail_tensor(file, tensor->name, "leaves a gap before it", error);
		end = tensor->end;
		file->by_name[i] = &file->tensors[i];
	}
	if (end != data_bytes)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: %zu bytes after the last tensor belong to none",
				 name_of(file), data_bytes - end);
	qsort(file->by_name, file->count, sizeof(struct dvsm_tensor *), compare_names);
	return DVSM_OK;
}

/* Takes over file->source; closes everything on failure. */
static enum dvsm_status open_source(struct dvsm_safetensors *file, struct dvsm_error *error)
{
	size_t length = 0;
	dvsm_sha256_init(&file->file_hash);
	enum dvsm_status status = read_header_length(file, &length, error);
	if (status == DVSM_OK)
		status = parse_header(file, length, error);
	if (status == DVSM_OK)
		status = parse_tensors(file, error);
	if (status == DVSM_OK)
		status = check_places(file, error);
	if (status != DVSM_OK)
		dvsm_safetensors_close(file);
	return status;
}

enum dvsm_status dvsm_safetensors_open(const char *path, struct dvsm_safetensors *file,
				       struct dvsm_error *error)
{
	*file = (struct dvsm_safetensors){.source.fd = -1};
	enum dvsm_status status = dvsm_source_open(path, &file->source, error);
	return status == DVSM_OK ? open_source(file, error) : status;
}

enum dvsm_status dvsm_safetensors_open_bytes(const void *bytes, size_t size, const char *name,
					     struct dvsm_safetensors *file,
					     struct dvsm_error *error)
{
	*file = (struct dvsm_safetensors){.source.fd = -1};
	dvsm_source_open_bytes(bytes, size, name, &file->source);
	return open_source(file, error);
}

void dvsm_safetensors_close(struct dvsm_safetensors *file)
{
	dvsm_source_close(&file->source);
	dvsm_json_deinit(&file->json);
	free(file->tensors);
	free(file->by_name);
	file->tensors = NULL;
	file->by_name = NULL;
	file->count = 0;
}

const char *dvsm_safetensors_get_metadata(const struct dvsm_safetensors *file, const char *key)
{
	const struct dvsm_json_value *metadata =
		dvsm_json_find(&file->json, &file->json.values[0], "__metadata__");
	const struct dvsm_json_value *value =
		metadata ? dvsm_json_find(&file->json, metadata, key) : NULL;
	return value ? value->text : NULL;
}

struct dvsm_tensor *dvsm_safetensors_find(const struct dvsm_safetensors *file, const char *name)
{
	const struct dvsm_tensor wanted = {.name = name};
	const struct dvsm_tensor *key = &wanted;
	struct dvsm_tensor **found = bsearch(&key, file->by_name, file->count,
					     sizeof(struct dvsm_tensor *), compare_names);
	return found ? *found : NULL;
}
