/* The AMX kernels over a model of the instructions: for machines that have all but the tiles. */
#ifndef TESTS_KERNELS_AMX_TIERS_H
#define TESTS_KERNELS_AMX_TIERS_H

#include "kernels/fixed.h"
#include "kernels/kernels.h"

extern const struct dvsm_fixed_kernels amx_model_fixed_kernels;
extern const struct dvsm_kernels amx_model_bf16_kernels;

#endif
