/* The bfloat16 kernels, widened to floats, for Advanced SIMD (aarch64). */
#if defined(__aarch64__) /* tools that walk all sources come here on other machines too */

#include "kernels/tier.h"
#include "kernels/vec_neon.h"

/* 32 registers: 24 sums, 4 loaded, 1 broadcast. */
#define GEMM_ROWS         6
#define GEMM_PANELS       1
#define ATTENTION_VECTORS 4
#define ATTENTION_ROWS    6

#include "kernels/math.inc.h"

#include "kernels/number_bf16.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/attention.inc.h"
#include "kernels/bf16_gemm.inc.h"

const struct dvsm_kernels dvsm_kernels_bf16_neon = {
	.cpu = DVSM_CPU_NEON,
	.name = "neon",
	DVSM_KERNEL_FUNCTIONS,
};

#endif
