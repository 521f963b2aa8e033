/* The AMX-BF16 kernels as they are, over the model of the instructions. */
#define DVSM_AMX_MODEL
#define dvsm_kernels_bf16_amx amx_model_bf16_kernels

#include "kernels/bf16_amx.c"
#include "model_tiers.h"
