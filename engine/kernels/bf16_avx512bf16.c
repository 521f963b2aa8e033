/* The bfloat16 kernels for AVX-512 BF16. */
#include "kernels/tier.h"
#include "kernels/vec_avx512bf16.h"

/* 32 registers: 24 sums, 3 or 4 loaded, 1 broadcast. */
#define GEMM_ROWS         8
#define GEMM_PANELS       3
#define ATTENTION_VECTORS 4
#define ATTENTION_ROWS    6

#include "kernels/math.inc.h"

#include "kernels/number_bf16.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/dot_attention.inc.h"
#include "kernels/dot_gemm.inc.h"

const struct dvsm_kernels dvsm_kernels_bf16_avx512bf16 = {
	.cpu = DVSM_CPU_AVX512_BF16,
	.name = "avx512bf16",
	DVSM_KERNEL_FUNCTIONS,
};
