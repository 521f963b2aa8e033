/* Work to measure when nobody brings any: weights, pictures and cameras drawn from fixed seeds. */
#ifndef DIO_BENCH_DRAW_H
#define DIO_BENCH_DRAW_H

#include <stdio.h>

#include "core/view.h"
#include "dvsm/model.h"

/** A size to measure at, the same on every machine. */
struct dio_draw_size {
	const char *name;
	struct dvsm_model_config model;
	uint32_t width, height;      /* of the pictures */
	const char *patches, *views; /* lists, when the user names none */
	uint32_t runs;
};

/** "small" or "paper" (MODEL.md, section 8); NULL when there is no such size. */
const struct dio_draw_size *dio_draw_find(const char *name);

/**
 * Write a model file: F32, numbers scaled so that they keep their size from layer to layer.
 *
 * DIO_IO, DIO_NO_SPACE  the stream does not take it; DIO_NO_MEM
 */
enum dio_status dio_draw_model(const struct dvsm_model_config *config, FILE *stream,
			       struct dio_error *error);

/**
 * `count` context views on a ring that look at its centre, and one target between them. A view is
 * the same whatever the count, and the first ones are spread over the ring.
 *
 * set   zero-initialised; release with dio_view_set_deinit()
 */
enum dio_status dio_draw_views(uint32_t width, uint32_t height, uint32_t count,
			       struct dio_view_set *set, struct dio_error *error);

#endif
