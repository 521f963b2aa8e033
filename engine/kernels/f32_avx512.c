/* The float32 kernels for AVX-512 F, BW, DQ, VL. */
#include "kernels/tier.h"
#include "kernels/vec_avx512.h"

/* 32 registers: 24 sums, 3 or 4 loaded, 1 broadcast. */
#define GEMM_ROWS         8
#define GEMM_PANELS       3
#define ATTENTION_VECTORS 4
#define ATTENTION_ROWS    6

#include "kernels/math.inc.h"

#include "kernels/number_f32.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/attention.inc.h"
#include "kernels/f32_gemm.inc.h"

const struct dvsm_kernels dvsm_kernels_avx512 = {
	.cpu = DVSM_CPU_AVX512,
	.name = "avx512",
	DVSM_KERNEL_FUNCTIONS,
};
