/* The float32 kernels for AVX2 and FMA. */
#include "kernels/tier.h"
#include "kernels/vec_avx2.h"

/* 16 registers: 12 sums, 2 loaded, 1 broadcast. */
#define GEMM_ROWS         6
#define GEMM_PANELS       1
#define ATTENTION_VECTORS 2
#define ATTENTION_ROWS    6

#include "kernels/math.inc.h"

#include "kernels/number_f32.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/attention.inc.h"
#include "kernels/f32_gemm.inc.h"

const struct dvsm_kernels dvsm_kernels_avx2 = {
	.cpu = DVSM_CPU_AVX2,
	.name = "avx2",
	DVSM_KERNEL_FUNCTIONS,
};
