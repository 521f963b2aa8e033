/*
 * A machine with every instruction set of x86-64: what it lacks are models (model_tiers.h). A test
 * that links this runs whole engines on them; it is skipped where the models cannot run.
 */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "dvsm/engine.h"

enum { SKIPPED = 77 };

/* In place of the engine's own, of kernels/cpu.c. */
uint32_t dvsm_cpu_detect(void)
{
	return DVSM_CPU_SCALAR | DVSM_CPU_SSE2 | DVSM_CPU_SSE4 | DVSM_CPU_AVX2 | DVSM_CPU_AVX_VNNI |
	       DVSM_CPU_AVX512 | DVSM_CPU_VNNI | DVSM_CPU_AVX512_BF16 | DVSM_CPU_AMX_INT8 |
	       DVSM_CPU_AMX_BF16;
}

__attribute__((constructor)) static void skip_where_models_cannot_run(void)
{
	__builtin_cpu_init();
	if (__builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
	    __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512vnni") &&
	    __builtin_cpu_supports("avx512vbmi2") && __builtin_cpu_supports("avx512bf16"))
		return;
	printf("skipped: the models of AMX and AVX-VNNI need AVX-512 with VNNI, VBMI2 and "
	       "bfloat16\n");
	fflush(stdout);
	_exit(SKIPPED);
}
