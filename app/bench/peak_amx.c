#include "bench/peak_loops.h"

#include "dvsm/engine.h"

#if defined(__x86_64__)

#include <immintrin.h>

#define ROWS      16
#define ROW_BYTES 64

/* Palette 1: eight tiles of sixteen rows of 64 bytes; six gather sums, two hold the factors. */
struct tile_config {
	uint8_t palette, start_row, reserved[14];
	uint16_t row_bytes[16];
	uint8_t rows[16];
};

__attribute__((target("amx-tile"))) static void begin(const uint8_t factors[ROWS][ROW_BYTES])
{
	struct tile_config config = {.palette = 1};

	for (int i = 0; i < 8; i++) {
		config.row_bytes[i] = ROW_BYTES;
		config.rows[i] = ROWS;
	}
	/* gcc 12 does not know that _tile_loadconfig() reads memory. */
	__asm__ volatile("ldtilecfg %0" ::"m"(config) : "memory");
	_tile_zero(0);
	_tile_zero(1);
	_tile_zero(2);
	_tile_zero(3);
	_tile_zero(4);
	_tile_zero(5);
	_tile_loadd(6, factors, ROW_BYTES);
	_tile_loadd(7, factors, ROW_BYTES);
}

__attribute__((target("amx-tile"))) static void end(float *sink)
{
	float sums[ROWS][ROW_BYTES / sizeof(float)];

	_tile_stored(0, sums, ROW_BYTES);
	_tile_release();
	*sink = sums[0][0];
}

__attribute__((target("amx-tile,amx-int8"))) static void run_int8(uint64_t turns, float *sink)
{
	static const uint8_t factors[ROWS][ROW_BYTES] = {{1}};

	begin(factors);
	for (uint64_t i = 0; i < turns; i++) {
		_tile_dpbssd(0, 6, 7);
		_tile_dpbssd(1, 6, 7);
		_tile_dpbssd(2, 6, 7);
		_tile_dpbssd(3, 6, 7);
		_tile_dpbssd(4, 6, 7);
		_tile_dpbssd(5, 6, 7);
	}
	end(sink);
}

__attribute__((target("amx-tile,amx-bf16"))) static void run_bf16(uint64_t turns, float *sink)
{
	static const uint8_t factors[ROWS][ROW_BYTES] = {{0}};

	begin(factors);
	for (uint64_t i = 0; i < turns; i++) {
		_tile_dpbf16ps(0, 6, 7);
		_tile_dpbf16ps(1, 6, 7);
		_tile_dpbf16ps(2, 6, 7);
		_tile_dpbf16ps(3, 6, 7);
		_tile_dpbf16ps(4, 6, 7);
		_tile_dpbf16ps(5, 6, 7);
	}
	end(sink);
}

/* A tile of sums takes in 16 x 16 x (64 bytes of factors) products. */
#define OPERATIONS(factor_bytes) (2ull * 6 * ROWS * 16 * (ROW_BYTES / (factor_bytes)))

const struct dio_peak_loop dio_peak_loops_amx[] = {
	{"tdpbssd", DIO_UNIT_INT8, DVSM_CPU_AMX_INT8, OPERATIONS(1), run_int8},
	{"tdpbf16ps", DIO_UNIT_BF16, DVSM_CPU_AMX_BF16, OPERATIONS(2), run_bf16},
	{0},
};

#else

const struct dio_peak_loop dio_peak_loops_amx[] = {{0}};

#endif
