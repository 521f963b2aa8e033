/* The float32 kernels for SSE2, which every x86-64 has: small processors stop short of AVX. */
#include "kernels/tier.h"
#include "kernels/vec_sse2.h"

/* 16 registers: 8 sums, 4 loaded, 1 broadcast, 1 product. */
#define GEMM_ROWS         2
#define GEMM_PANELS       1
#define ATTENTION_VECTORS 2
#define ATTENTION_ROWS    4

#include "kernels/math.inc.h"

#include "kernels/number_f32.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/attention.inc.h"
#include "kernels/f32_gemm.inc.h"

const struct dvsm_kernels dvsm_kernels_sse2 = {
	.cpu = DVSM_CPU_SSE2,
	.name = "sse2",
	DVSM_KERNEL_FUNCTIONS,
};
