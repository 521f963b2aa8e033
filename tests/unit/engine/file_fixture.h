/* Safetensors files made in memory, so that a test can break one thing and keep the rest. */
#ifndef FILE_FIXTURE_H
#define FILE_FIXTURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dvsm/dvsm.h"

#define FIXTURE_TENSORS 64

struct fixture_tensor {
	char name[64];
	char dtype[16];
	char shape[64]; /* as written: "[8, 8]" */
	long long begin, end;
	bool is_dropped; /* left out of the header; its bytes stay */
};

struct fixture_file {
	char format[32], version[32];
	char config[512];
	struct fixture_tensor tensors[FIXTURE_TENSORS];
	size_t count;
	unsigned char *data;
	size_t data_size;
};

/**
 * A tiny model that opens: dim 8, heads 2, layers 1, patch 2, mlp_ratio 2; random weights of
 * `dtype` (F32, F16 or BF16). Release with fixture_deinit().
 */
void fixture_init_model(struct fixture_file *file, const char *dtype);
void fixture_deinit(struct fixture_file *file);

struct fixture_tensor *fixture_find(struct fixture_file *file, const char *name);

/** Append a tensor of `size` zero bytes behind the last; shape as written. */
void fixture_append(struct fixture_file *file, const char *name, const char *dtype,
		    const char *shape, size_t size);

/** The file's bytes in an allocation of exactly their size; release with free(). */
unsigned char *fixture_emit(const struct fixture_file *file, size_t *size);

/** A file with any text for a header; release with free(). */
unsigned char *fixture_emit_header(const char *header, const void *data, size_t data_size,
				   size_t *size);

/** Open a model from a copy of the bytes in an allocation of exactly their size. */
enum dvsm_status fixture_open_model(const unsigned char *bytes, size_t size,
				    struct dvsm_model **model, struct dvsm_error *error);

/** Emit and open; fails the test unless refused with `status` and a text that has both needles. */
void assert_model_refused(const struct fixture_file *file, enum dvsm_status status,
			  const char *needle, const char *other_needle);

/** Fails the test unless the error's one line has the needle. */
void assert_text_has(const struct dvsm_error *error, const char *needle);

/** A folder of its own under TMPDIR; fails the test when it cannot be made. */
void fixture_make_folder(char path[256]);

/** Remove the folder and the files in it. */
void fixture_remove_folder(const char *path);

/** Deterministic numbers in [-1, 1). */
double fixture_random(uint64_t *state);

#endif
