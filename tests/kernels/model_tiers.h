/*
 * Kernels over a model of their instructions, for machines that lack those: AMX in C (amx_model.h),
 * AVX-VNNI as AVX-512 VNNI encodes it.
 */
#ifndef TESTS_KERNELS_MODEL_TIERS_H
#define TESTS_KERNELS_MODEL_TIERS_H

#include "kernels/fixed.h"
#include "kernels/kernels.h"

extern const struct dvsm_fixed_kernels amx_model_fixed_kernels;
extern const struct dvsm_fixed_kernels avxvnni_model_fixed_kernels;
extern const struct dvsm_kernels amx_model_bf16_kernels;

#endif
