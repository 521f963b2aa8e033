/* What the figures were taken on. */
#ifndef DIO_BENCH_MACHINE_H
#define DIO_BENCH_MACHINE_H

#include <stddef.h>
#include <stdint.h>

struct dio_machine {
	char processor[128];     /* as the system names it, "unknown" otherwise */
	uint32_t processors;     /* that this process may use */
	char system[160];        /* "Linux 6.1.0 x86_64" */
	char compiler[64];       /* that built this program */
	char tiers[128];         /* instruction sets, "sse2 avx2 avx512" */
	size_t memory_bytes;     /* 0: unknown */
	size_t last_cache_bytes; /* of the last level; 0: unknown */
};

void dio_machine_describe(struct dio_machine *machine);

#endif
