#include "model/config.h"

#include <stddef.h>
#include <string.h>

#include "base/error.h"

/* Far above any model there is, and small enough that no product of sizes overflows 64 bits. */
#define MAX_DIM       16384u
#define MAX_HEADS     1024u
#define MAX_LAYERS    1024u
#define MAX_PATCH_PX  256u
#define MAX_MLP_RATIO 64u
#define MAX_PRIOR_DIM 65536u
#define MAX_NORM_EPS  0.1

static enum dvsm_status fail_key(const char *name, const char *key, const char *fault,
				 enum dvsm_status status, struct dvsm_error *error)
{
	return dvsm_fail(error, status, "%s: config: %.80s %s", dvsm_name_tail(name), key, fault);
}

enum dvsm_status dvsm_config_open(const char *text, const char *name, struct dvsm_json *json,
				  struct dvsm_error *error)
{
	struct dvsm_json_fault fault;
	if (!text)
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: has no config in its metadata",
				 dvsm_name_tail(name));
	if (!dvsm_json_init(json, text, strlen(text), &fault))
		return dvsm_fail(error, fault.no_memory ? DVSM_NO_MEM : DVSM_BAD_FILE,
				 "%s: config is not JSON: %s at byte %zu", dvsm_name_tail(name),
				 fault.what, fault.byte);
	if (json->values[0].type != DVSM_JSON_OBJECT) {
		dvsm_json_deinit(json);
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: config is not an object",
				 dvsm_name_tail(name));
	}
	return DVSM_OK;
}

static enum dvsm_status get_count(const struct dvsm_json *json,
				  const struct dvsm_json_value *object, const char *name,
				  const char *key, uint32_t low, uint32_t high, uint32_t *value,
				  struct dvsm_error *error)
{
	const struct dvsm_json_value *member = dvsm_json_find(json, object, key);
	if (!member)
		return fail_key(name, key, "is missing", DVSM_BAD_FILE, error);
	if (!member->is_count)
		return fail_key(name, key, "is not a whole number", DVSM_BAD_FILE, error);
	if (member->count < low || member->count > high)
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: config: %s is %llu, must be %u..%u",
				 dvsm_name_tail(name), key, (unsigned long long)member->count, low,
				 high);
	*value = (uint32_t)member->count;
	return DVSM_OK;
}

enum dvsm_status dvsm_config_get_count(const struct dvsm_json *json, const char *name,
				       const char *key, uint32_t low, uint32_t high,
				       uint32_t *value, struct dvsm_error *error)
{
	return get_count(json, &json->values[0], name, key, low, high, value, error);
}

enum dvsm_status dvsm_config_get_sizes(const struct dvsm_json *json, const char *name,
				       uint32_t *dim, uint32_t *heads, uint32_t *layers,
				       struct dvsm_error *error)
{
	enum dvsm_status status;
	status = dvsm_config_get_count(json, name, "dim", 1, MAX_DIM, dim, error);
	if (status == DVSM_OK)
		status = dvsm_config_get_count(json, name, "heads", 1, MAX_HEADS, heads, error);
	if (status == DVSM_OK)
		status = dvsm_config_get_count(json, name, "layers", 1, MAX_LAYERS, layers, error);
	if (status == DVSM_OK && *dim % *heads != 0)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: config: dim %u is not a multiple of heads %u",
				 dvsm_name_tail(name), *dim, *heads);
	return status;
}

static enum dvsm_status get_norm_eps(const struct dvsm_json *json, const char *name, double *value,
				     struct dvsm_error *error)
{
	const struct dvsm_json_value *member = dvsm_json_find(json, &json->values[0], "norm_eps");
	if (!member)
		return fail_key(name, "norm_eps", "is missing", DVSM_BAD_FILE, error);
	if (member->type != DVSM_JSON_NUMBER)
		return fail_key(name, "norm_eps", "is not a number", DVSM_BAD_FILE, error);
	/* Zero would divide by the deviation of a constant token; float must hold it as well. */
	if (!(member->number >= 1e-30 && member->number <= MAX_NORM_EPS))
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: config: norm_eps is %g, must be above 0 and at most %g",
				 dvsm_name_tail(name), member->number, MAX_NORM_EPS);
	*value = member->number;
	return DVSM_OK;
}

/* A text out of a set; *text is NULL when the key is missing. */
static enum dvsm_status get_text(const struct dvsm_json *json, const char *name, const char *key,
				 const char **text, struct dvsm_error *error)
{
	const struct dvsm_json_value *member = dvsm_json_find(json, &json->values[0], key);
	*text = NULL;
	if (!member)
		return DVSM_OK;
	if (member->type != DVSM_JSON_STRING)
		return fail_key(name, key, "is not a text", DVSM_BAD_FILE, error);
	*text = member->text;
	return DVSM_OK;
}

static enum dvsm_status get_rgb_out(const struct dvsm_json *json, const char *name, bool *sigmoid,
				    struct dvsm_error *error)
{
	const char *text;
	enum dvsm_status status = get_text(json, name, "rgb_out", &text, error);
	if (status != DVSM_OK)
		return status;
	*sigmoid = text && strcmp(text, "sigmoid") == 0;
	if (text && !*sigmoid && strcmp(text, "linear") != 0)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "%s: config: rgb_out \"%.80s\" is neither linear nor sigmoid",
				 dvsm_name_tail(name), text);
	return DVSM_OK;
}

static enum dvsm_status check_pose_norm(const struct dvsm_json *json, const char *name,
					struct dvsm_error *error)
{
	const char *text;
	enum dvsm_status status = get_text(json, name, "pose_norm", &text, error);
	if (status != DVSM_OK)
		return status;
	if (!text)
		return fail_key(name, "pose_norm", "is missing", DVSM_BAD_FILE, error);
	if (strcmp(text, "gs-lrm") != 0)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "%s: config: pose_norm \"%.80s\" is unknown, only gs-lrm is done",
				 dvsm_name_tail(name), text);
	return DVSM_OK;
}

/* Tensors tell their type themselves; the key keeps builds away that do not know int8. */
static enum dvsm_status get_quantisation(const struct dvsm_json *json, const char *name,
					 bool *turned, struct dvsm_error *error)
{
	const char *text;
	enum dvsm_status status = get_text(json, name, "quantisation", &text, error);
	if (status != DVSM_OK)
		return status;
	*turned = text && strcmp(text, "int8-turned") == 0;
	if (text && !*turned && strcmp(text, "int8") != 0)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "%s: config: quantisation \"%.80s\" is neither int8 nor "
				 "int8-turned",
				 dvsm_name_tail(name), text);
	return status;
}

static enum dvsm_status get_prior(const struct dvsm_json *json, const char *name,
				  uint32_t *prior_dim, struct dvsm_error *error)
{
	const struct dvsm_json_value *prior = dvsm_json_find(json, &json->values[0], "prior");
	*prior_dim = 0;
	if (!prior)
		return fail_key(name, "prior", "is missing (null for none)", DVSM_BAD_FILE, error);
	if (prior->type == DVSM_JSON_NULL)
		return DVSM_OK;
	if (prior->type != DVSM_JSON_OBJECT)
		return fail_key(name, "prior", "is neither null nor an object", DVSM_BAD_FILE,
				error);
	return get_count(json, prior, name, "dim", 1, MAX_PRIOR_DIM, prior_dim, error);
}

/* A key this build does not know may change what the weights mean, as quantisation does. */
static enum dvsm_status check_keys(const struct dvsm_json *json, const char *name,
				   struct dvsm_error *error)
{
	static const char *const known[] = {"dim",       "heads",       "layers",  "patch",
					    "mlp_ratio", "norm_eps",    "rgb_out", "pose_norm",
					    "prior",     "quantisation"};
	const struct dvsm_json_value *member = dvsm_json_first(json, &json->values[0]);
	for (; member; member = dvsm_json_next(json, member)) {
		size_t i = 0;
		while (i < sizeof(known) / sizeof(known[0]) && strcmp(known[i], member->key) != 0)
			i++;
		if (i == sizeof(known) / sizeof(known[0]))
			return fail_key(name, member->key,
					"is not known to this build (a quantised or newer model?): "
					"update the engine or export the model as F32, F16 or BF16",
					DVSM_UNSUPPORTED, error);
	}
	return DVSM_OK;
}

static enum dvsm_status parse(const struct dvsm_json *json, const char *name,
			      struct dvsm_model_config *config, bool *turned,
			      struct dvsm_error *error)
{
	enum dvsm_status status = check_keys(json, name, error);
	if (status == DVSM_OK)
		status = dvsm_config_get_sizes(json, name, &config->dim, &config->heads,
					       &config->layers, error);
	if (status == DVSM_OK)
		status = dvsm_config_get_count(json, name, "patch", 1, MAX_PATCH_PX,
					       &config->patch_px, error);
	if (status == DVSM_OK)
		status = dvsm_config_get_count(json, name, "mlp_ratio", 1, MAX_MLP_RATIO,
					       &config->mlp_ratio, error);
	if (status == DVSM_OK)
		status = get_norm_eps(json, name, &config->norm_eps, error);
	if (status == DVSM_OK)
		status = get_rgb_out(json, name, &config->rgb_sigmoid, error);
	if (status == DVSM_OK)
		status = check_pose_norm(json, name, error);
	if (status == DVSM_OK)
		status = get_quantisation(json, name, turned, error);
	if (status == DVSM_OK)
		status = get_prior(json, name, &config->prior_dim, error);
	return status;
}

enum dvsm_status dvsm_config_parse(const char *text, const char *name,
				   struct dvsm_model_config *config, bool *turned,
				   struct dvsm_error *error)
{
	struct dvsm_json json;
	enum dvsm_status status = dvsm_config_open(text, name, &json, error);
	if (status != DVSM_OK)
		return status;
	struct dvsm_model_config parsed = {0};
	status = parse(&json, name, &parsed, turned, error);
	if (status == DVSM_OK)
		*config = parsed;
	dvsm_json_deinit(&json);
	return status;
}
