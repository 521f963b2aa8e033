/* The model's configuration, a JSON text in the file's metadata. Private to the engine. */
#ifndef DVSM_MODEL_CONFIG_H
#define DVSM_MODEL_CONFIG_H

#include "dvsm/model.h"
#include "files/json.h"

/**
 * Parse and check a configuration (MODEL.md section 6).
 *
 * name    the file, for error texts
 * turned  receives whether the weights are those of precision fixed
 *
 * DVSM_BAD_FILE     not JSON; a key missing, of the wrong type or out of range
 * DVSM_UNSUPPORTED  a key, a pose normalisation or an output this build does not know
 */
enum dvsm_status dvsm_config_parse(const char *text, const char *name,
				   struct dvsm_model_config *config, bool *turned,
				   struct dvsm_error *error);

/** Parse a configuration text to an object; release with dvsm_json_deinit(). */
enum dvsm_status dvsm_config_open(const char *text, const char *name, struct dvsm_json *json,
				  struct dvsm_error *error);

/** Whole number `key` of the root object, low..high; DVSM_BAD_FILE names the key. */
enum dvsm_status dvsm_config_get_count(const struct dvsm_json *json, const char *name,
				       const char *key, uint32_t low, uint32_t high,
				       uint32_t *value, struct dvsm_error *error);

/** The sizes that models and scenes state alike: dim, heads (dividing it), layers. */
enum dvsm_status dvsm_config_get_sizes(const struct dvsm_json *json, const char *name,
				       uint32_t *dim, uint32_t *heads, uint32_t *layers,
				       struct dvsm_error *error);

#endif
