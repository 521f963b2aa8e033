/*
 * The matrices of a model one after the other, from the panels it keeps or, while it is opened for
 * a precision that does not read them, from its file. Private to the engine.
 */
#ifndef DVSM_MODEL_READER_H
#define DVSM_MODEL_READER_H

#include "files/safetensors.h"
#include "model/model.h"

/** Zero-initialised: reads what the model keeps. Otherwise release with dvsm_reader_deinit(). */
struct dvsm_reader {
	struct dvsm_safetensors *file; /* loaded; borrowed */
	struct dvsm_error *error;      /* of the first failure; may be NULL */
	enum dvsm_status status;       /* of the first failure: weights are 0 from there on */
	float *panels;                 /* of the matrix read last; owned */
	size_t floats;                 /* room */
};

/**
 * Read a model's matrices from its file; both are borrowed.
 *
 * DVSM_NO_MEM  no memory for the largest one
 */
enum dvsm_status dvsm_reader_init(struct dvsm_reader *reader, const struct dvsm_model *model,
				  struct dvsm_safetensors *file, struct dvsm_error *error);
void dvsm_reader_deinit(struct dvsm_reader *reader);

/** The matrix with its panels, which stay until the next one is read. */
struct dvsm_matrix dvsm_reader_read(struct dvsm_reader *reader, const struct dvsm_matrix *matrix);

#endif
