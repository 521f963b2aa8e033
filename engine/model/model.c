#include "model/model.h"

const struct dvsm_model_config *dvsm_model_get_config(const struct dvsm_model *model)
{
	return &model->config;
}

const char *dvsm_model_get_sha256(const struct dvsm_model *model)
{
	return model->sha256;
}

uint64_t dvsm_model_get_weight_count(const struct dvsm_model *model)
{
	return model->weight_count;
}

const char *dvsm_precision_name(enum dvsm_precision precision)
{
	static const char *const names[] = {
		[DVSM_PRECISION_F32] = "f32",
		[DVSM_PRECISION_BF16] = "bf16",
		[DVSM_PRECISION_FIXED] = "fixed",
	};

	return (size_t)precision < sizeof(names) / sizeof(names[0]) ? names[precision] : "unknown";
}
