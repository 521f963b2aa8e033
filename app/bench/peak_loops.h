/*
 * Register-blocked multiply-accumulate loops, one an instruction: what the machine can do when
 * nothing waits for memory. Private to app/bench.
 */
#ifndef DIO_BENCH_PEAK_LOOPS_H
#define DIO_BENCH_PEAK_LOOPS_H

#include <stddef.h>
#include <stdint.h>

/** What multiplies: numbers of one type, summed up in a wider or the same one. */
enum dio_unit {
	DIO_UNIT_F32,  /* float32 into float32 */
	DIO_UNIT_BF16, /* bfloat16 into float32 */
	DIO_UNIT_INT8, /* 8-bit into 32-bit integers */
	DIO_UNIT_COUNT,
};

/**
 * One loop.
 *
 * cpu   tiers of enum dvsm_cpu that must all be there
 * run   does `turns` turns of `operations` (a multiplication and an addition are two), and leaves
 *       in *sink a number that depends on all of them
 */
struct dio_peak_loop {
	const char *instruction;
	enum dio_unit unit;
	uint32_t cpu;
	uint64_t operations;
	void (*run)(uint64_t turns, float *sink);
};

/** Accumulators that hide the latency of a multiply-add on every core known to us. */
#define DIO_PEAK_CHAINS 12

/* The compiler knows nothing of a chain's start: chains that it finds equal it would run as one. */
#if defined(__aarch64__)
#define DIO_PEAK_HIDE(chain) __asm__("" : "+w"(chain))
#else
#define DIO_PEAK_HIDE(chain) __asm__("" : "+x"(chain))
#endif

/* Ends with an entry without `run`; those of other architectures are empty. */
extern const struct dio_peak_loop dio_peak_loops_x86[];
extern const struct dio_peak_loop dio_peak_loops_amx[];
extern const struct dio_peak_loop dio_peak_loops_neon[];
extern const struct dio_peak_loop dio_peak_loops_neon_dot[];

#endif
