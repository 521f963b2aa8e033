#include "file_fixture.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "model/model.h"
#include "weights/open.h"

double fixture_random(uint64_t *state)
{
	/* splitmix64 */
	uint64_t z = *state += 0x9e3779b97f4a7c15;
	z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9;
	z = (z ^ z >> 27) * 0x94d049bb133111eb;
	z ^= z >> 31;
	return (double)(z >> 11) * 0x1p-52 - 1;
}

static void write_number(unsigned char *at, const char *dtype, float value)
{
	uint32_t image;
	memcpy(&image, &value, sizeof(image));
	if (strcmp(dtype, "F32") == 0) {
		memcpy(at, &image, 4);
		return;
	}
	uint16_t half = (uint16_t)(image >> 16);
	if (strcmp(dtype, "F16") == 0) {
		/* Truncated; magnitudes here are far inside half's range. */
		uint32_t exponent = image >> 23 & 0xff;
		half = exponent < 113 ? 0
				      : (uint16_t)((image >> 16 & 0x8000) | (exponent - 112) << 10 |
						   (image >> 13 & 0x3ff));
	}
	memcpy(at, &half, 2);
}

static void append_weights(struct fixture_file *file, const char *name, const char *dtype,
			   unsigned rows, unsigned columns, uint64_t *state)
{
	char shape[64];
	size_t bytes = strcmp(dtype, "F32") == 0 ? 4 : 2;
	size_t count = (size_t)(rows ? rows : 1) * columns;
	if (rows)
		snprintf(shape, sizeof(shape), "[%u, %u]", rows, columns);
	else
		snprintf(shape, sizeof(shape), "[%u]", columns);
	fixture_append(file, name, dtype, shape, count * bytes);
	unsigned char *at = file->data + file->data_size - count * bytes;
	for (size_t i = 0; i < count; i++)
		write_number(at + i * bytes, dtype, (float)fixture_random(state));
}

static void append_half(struct fixture_file *file, const char *half, const char *dtype,
			uint64_t *state)
{
	static const struct {
		const char *rest;
		unsigned rows, columns;
	} parts[] = {
		{"_norm", 0, 8}, {".qkv", 24, 8},     {".q_norm", 0, 4},  {".k_norm", 0, 4},
		{".out", 8, 8},  {"_mlp_norm", 0, 8}, {"_mlp.up", 16, 8}, {"_mlp.down", 8, 16},
	};
	for (size_t i = 0; i < sizeof(parts) / sizeof(parts[0]); i++) {
		char name[64];
		snprintf(name, sizeof(name), "blocks.0.%s%s.weight", half, parts[i].rest);
		append_weights(file, name, dtype, parts[i].rows, parts[i].columns, state);
	}
}

void fixture_init_model(struct fixture_file *file, const char *dtype)
{
	uint64_t state = 1;
	*file = (struct fixture_file){0};
	strcpy(file->format, "dvsm");
	strcpy(file->version, "1");
	strcpy(file->config, "{\"dim\": 8, \"heads\": 2, \"layers\": 1, \"patch\": 2, "
			     "\"mlp_ratio\": 2, \"norm_eps\": 1e-06, \"rgb_out\": \"linear\", "
			     "\"pose_norm\": \"gs-lrm\", \"prior\": null}");
	append_weights(file, "patch_ray.weight", dtype, 8, 24, &state);
	append_weights(file, "patch_rgb.weight", dtype, 8, 12, &state);
	append_weights(file, "embed_norm.weight", dtype, 0, 8, &state);
	append_half(file, "intra", dtype, &state);
	append_half(file, "cross", dtype, &state);
	append_weights(file, "final_norm.weight", dtype, 0, 8, &state);
	append_weights(file, "to_rgb.weight", dtype, 12, 8, &state);
}

void fixture_deinit(struct fixture_file *file)
{
	free(file->data);
	file->data = NULL;
}

struct fixture_tensor *fixture_find(struct fixture_file *file, const char *name)
{
	for (size_t i = 0; i < file->count; i++) {
		if (strcmp(file->tensors[i].name, name) == 0)
			return &file->tensors[i];
	}
	fail_msg("no tensor %s in the fixture", name);
	return NULL;
}

void fixture_append(struct fixture_file *file, const char *name, const char *dtype,
		    const char *shape, size_t size)
{
	assert_true(file->count < FIXTURE_TENSORS);
	struct fixture_tensor *tensor = &file->tensors[file->count++];
	snprintf(tensor->name, sizeof(tensor->name), "%s", name);
	snprintf(tensor->dtype, sizeof(tensor->dtype), "%s", dtype);
	snprintf(tensor->shape, sizeof(tensor->shape), "%s", shape);
	tensor->begin = (long long)file->data_size;
	tensor->end = tensor->begin + (long long)size;
	file->data = realloc(file->data, file->data_size + size + 1);
	assert_non_null(file->data);
	memset(file->data + file->data_size, 0, size);
	file->data_size += size;
}

/* A text as JSON within quotes; only quotes occur that need escaping. */
static void put_escaped(FILE *out, const char *text)
{
	for (; *text; text++) {
		if (*text == '"' || *text == '\\')
			fputc('\\', out);
		fputc(*text, out);
	}
}

unsigned char *fixture_emit_header(const char *header, const void *data, size_t data_size,
				   size_t *size)
{
	size_t length = strlen(header);
	unsigned char *bytes = malloc(8 + length + data_size);
	assert_non_null(bytes);
	for (int i = 0; i < 8; i++)
		bytes[i] = (unsigned char)((uint64_t)length >> (8 * i));
	memcpy(bytes + 8, header, length);
	if (data_size)
		memcpy(bytes + 8 + length, data, data_size);
	*size = 8 + length + data_size;
	return bytes;
}

unsigned char *fixture_emit(const struct fixture_file *file, size_t *size)
{
	char *header = NULL;
	size_t length;
	FILE *out = open_memstream(&header, &length);
	assert_non_null(out);
	fprintf(out, "{\"__metadata__\": {\"format\": \"%s\", \"version\": \"%s\", \"config\": \"",
		file->format, file->version);
	put_escaped(out, file->config);
	fprintf(out, "\"}");
	for (size_t i = 0; i < file->count; i++) {
		const struct fixture_tensor *t = &file->tensors[i];
		if (!t->is_dropped)
			fprintf(out,
				", \"%s\": {\"dtype\": \"%s\", \"shape\": %s, "
				"\"data_offsets\": [%lld, %lld]}",
				t->name, t->dtype, t->shape, t->begin, t->end);
	}
	fprintf(out, "}");
	assert_int_equal(fclose(out), 0);
	unsigned char *bytes = fixture_emit_header(header, file->data, file->data_size, size);
	free(header);
	return bytes;
}

enum dvsm_status fixture_open_model(const unsigned char *bytes, size_t size,
				    struct dvsm_model **model, struct dvsm_error *error)
{
	/* Of exactly this size, so that a sanitizer sees a read beyond the end. */
	unsigned char *copy = malloc(size ? size : 1);
	assert_non_null(copy);
	if (size)
		memcpy(copy, bytes, size);
	enum dvsm_status status = dvsm_model_open_bytes(copy, size, "m.safetensors", model, error);
	free(copy);
	return status;
}

void assert_text_has(const struct dvsm_error *error, const char *needle)
{
	if (!strstr(error->text, needle))
		fail_msg("\"%s\" does not say \"%s\"", error->text, needle);
}

void assert_model_refused(const struct fixture_file *file, enum dvsm_status status,
			  const char *needle, const char *other_needle)
{
	size_t size;
	unsigned char *bytes = fixture_emit(file, &size);
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {""};
	assert_int_equal(fixture_open_model(bytes, size, &model, &error), status);
	assert_null(model);
	assert_text_has(&error, needle);
	assert_text_has(&error, other_needle);
	free(bytes);
}

void fixture_make_folder(char path[256])
{
	const char *base = getenv("TMPDIR");
	snprintf(path, 256, "%s/dvsm-test-XXXXXX", base && *base ? base : "/tmp");
	assert_non_null(mkdtemp(path));
}

void fixture_remove_folder(const char *path)
{
	DIR *folder = opendir(path);
	assert_non_null(folder);
	for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
		char name[600];
		snprintf(name, sizeof(name), "%s/%s", path, entry->d_name);
		if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0)
			unlink(name);
	}
	closedir(folder);
	rmdir(path);
}
