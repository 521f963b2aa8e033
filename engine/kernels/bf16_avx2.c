/* The bfloat16 kernels, widened to floats, for AVX2 and FMA. */
#include "kernels/tier.h"
#include "kernels/vec_avx2.h"

/* 16 registers: of products 8 sums, 4 of weights, 2 of rows; of attention 12 sums, 2 loaded, 1
 * broadcast. */
#define GEMM_ROWS         4
#define GEMM_PANELS       1
#define ATTENTION_VECTORS 2
#define ATTENTION_ROWS    6

#include "kernels/math.inc.h"

#include "kernels/number_bf16.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/attention.inc.h"
#include "kernels/bf16_gemm.inc.h"

const struct dvsm_kernels dvsm_kernels_bf16_avx2 = {
	.cpu = DVSM_CPU_AVX2,
	.name = "avx2",
	DVSM_KERNEL_FUNCTIONS,
};
