/* The AMX-INT8 kernels as they are, over the model of the instructions. */
#define DVSM_AMX_MODEL

#include "kernels/fixed_amx.c"
