/* Which model, what its card says, and which stage patch suits it. */
#ifndef DIO_APP_MODEL_CHOICE_H
#define DIO_APP_MODEL_CHOICE_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/status.h"

/**
 * The shipped model: a *.safetensors file in `models` beside the program, up to three folders
 * above, or in ../share/diorama/models. Of several, the one whose NAME.json says "default": true,
 * else the first by name. Release *path with free().
 */
enum dio_status dio_model_find_shipped(char **path, struct dio_error *error);

/** What programs need to know of weights. */
struct dio_model_card {
	uint32_t tokens_per_view; /* that they were trained with; 0: not stated */
	bool deblock;             /* their pictures are the better for it */
};

/**
 * Read NAME.json beside NAME.safetensors, {"tokens_per_view": 64, "deblock": true}: what it does
 * not state is 0 and false, as all is where there is no such file.
 */
enum dio_status dio_model_read_card(const char *model_path, struct dio_model_card *card,
				    struct dio_error *error);

/**
 * The stage patch for a picture: the p in 1..256 whose token count round(W/p) x round(H/p) is
 * nearest to `tokens_per_view`, of equals the one that divides the picture best; `patch_px` of the
 * model when it is 0.
 */
uint32_t dio_model_choose_patch(uint32_t tokens_per_view, uint32_t patch_px, uint32_t width,
				uint32_t height);

#endif
