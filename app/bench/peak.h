/* What this machine can do at most, measured here and now: the scale for all other figures. */
#ifndef DIO_BENCH_PEAK_H
#define DIO_BENCH_PEAK_H

#include "bench/peak_loops.h"
#include "dio/status.h"
#include "dvsm/engine.h"

struct dio_peak_unit {
	const char *instruction; /* the fastest for this unit; NULL: the machine has none */
	double operations_per_s; /* a multiplication and an addition are two */
};

struct dio_peak {
	uint32_t threads;
	struct dio_peak_unit units[DIO_UNIT_COUNT];
	double read_bytes_per_s; /* sweep over memory larger than every cache */
};

/**
 * Measure with `threads` threads at once, each on a processor of its own as far as there are
 * enough: some tenths of a second an instruction, the best of a few runs.
 *
 * cpu_mask  tiers whose instructions may be used; 0: all
 *
 * DIO_NO_MEM  memory or threads ran out
 */
enum dio_status dio_peak_measure(uint32_t threads, uint32_t cpu_mask, struct dio_peak *peak,
				 struct dio_error *error);

/**
 * The fastest way to multiply for a precision: float32 may stand in for bfloat16, which only saves
 * memory on machines whose bfloat16 instruction is slower.
 */
const struct dio_peak_unit *dio_peak_for(const struct dio_peak *peak,
					 enum dvsm_precision precision);

/** "f32", "bf16", "int8". */
const char *dio_unit_name(enum dio_unit unit);

#endif
