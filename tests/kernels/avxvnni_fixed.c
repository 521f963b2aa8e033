/* The AVX-VNNI kernels as they are, with the instructions that AVX-512 VNNI has of them. */
#define DVSM_AVXVNNI_MODEL

#include "kernels/fixed_avxvnni.c"
