/* The AVX-VNNI kernels as they are, with the instructions that AVX-512 VNNI has of them. */
#define DVSM_AVXVNNI_MODEL
#define dvsm_fixed_kernels_avxvnni avxvnni_model_fixed_kernels

#include "kernels/fixed_avxvnni.c"
#include "model_tiers.h"
