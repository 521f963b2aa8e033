#include "model/reader.h"

#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "base/memory.h"

static void grow(size_t *most, const struct dvsm_matrix *matrix)
{
	size_t floats = 0;

	if (!dvsm_pack_size(matrix->out, matrix->in, &floats))
		floats = SIZE_MAX;
	*most = floats > *most ? floats : *most;
}

static void grow_half(size_t *most, const struct dvsm_half_weights *half)
{
	grow(most, &half->query);
	grow(most, &half->key_value);
	grow(most, &half->out);
	grow(most, &half->up);
	grow(most, &half->down);
}

enum dvsm_status dvsm_reader_init(struct dvsm_reader *reader, const struct dvsm_model *model,
				  struct dvsm_safetensors *file, struct dvsm_error *error)
{
	const struct dvsm_weights *w = &model->weights;
	size_t most = 0, bytes = 0;

	grow(&most, &w->patch_ray);
	grow(&most, &w->patch_rgb);
	grow(&most, &w->to_rgb);
	/* All blocks are alike. */
	grow_half(&most, &w->blocks[0].intra);
	*reader = (struct dvsm_reader){.file = file, .error = error, .floats = most};
	if (dvsm_size_mul(most, sizeof(float), &bytes))
		reader->panels = dvsm_aligned_alloc(bytes);
	if (reader->panels)
		return DVSM_OK;
	return dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to convert its weights",
			 dvsm_name_tail(file->source.name));
}

void dvsm_reader_deinit(struct dvsm_reader *reader)
{
	free(reader->panels);
	*reader = (struct dvsm_reader){0};
}

struct part {
	const struct dvsm_matrix *matrix;
	float *panels;
};

static void pack_part(void *context, size_t first, const float *numbers, size_t count)
{
	const struct part *part = context;

	dvsm_pack_run(numbers, first, count, part->matrix->in, part->panels);
}

struct dvsm_matrix dvsm_reader_read(struct dvsm_reader *reader, const struct dvsm_matrix *matrix)
{
	struct dvsm_matrix read = *matrix;
	struct part part = {matrix, reader->panels};

	if (!reader->file)
		return read;
	dvsm_pack_pad(matrix->out, matrix->in, reader->panels);
	if (reader->status == DVSM_OK)
		reader->status = dvsm_safetensors_read_part(
			reader->file, &reader->file->tensors[matrix->tensor],
			matrix->first_row * matrix->in, matrix->out * matrix->in, pack_part, &part,
			reader->error);
	if (reader->status != DVSM_OK)
		memset(reader->panels, 0, reader->floats * sizeof(*reader->panels));
	read.panels = reader->panels;
	return read;
}
