/* Names of a model file's tensors (MODEL.md section 6). Private to the engine. */
#ifndef DVSM_MODEL_NAMES_H
#define DVSM_MODEL_NAMES_H

#include <stdint.h>
#include <stdio.h>

struct dvsm_tensor_name {
	char text[80];
};

/** blocks.{index}.{half}{rest}.weight */
static inline struct dvsm_tensor_name dvsm_name_half(uint32_t index, const char *half,
						     const char *rest)
{
	struct dvsm_tensor_name name;

	snprintf(name.text, sizeof(name.text), "blocks.%u.%s%s.weight", index, half, rest);
	return name;
}

#endif
