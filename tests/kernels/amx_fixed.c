/* The AMX-INT8 kernels as they are, over the model of the instructions. */
#define DVSM_AMX_MODEL
#define dvsm_fixed_kernels_amx amx_model_fixed_kernels

#include "kernels/fixed_amx.c"
#include "model_tiers.h"
