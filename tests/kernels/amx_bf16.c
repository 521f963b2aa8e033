/* The AMX-BF16 kernels as they are, over the model of the instructions. */
#define DVSM_AMX_MODEL

#include "kernels/bf16_amx.c"
