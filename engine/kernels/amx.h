/*
 * The AMX instructions that the kernels use, by the number of a tile. Private.
 *
 * Tiles belong to a thread and slow its context switches while they are in use: a kernel opens them
 * with the shapes it needs, again where these change, and closes them before it returns. With
 * DVSM_AMX_MODEL the same names are a model of the instructions in C, which tests compile the
 * kernels against.
 */
#ifndef DVSM_KERNELS_AMX_H
#define DVSM_KERNELS_AMX_H

#include <immintrin.h>
#include <stdint.h>
#include <string.h>

/** What LDTILECFG reads: palette 1 has eight tiles of up to 16 rows of 64 bytes. */
struct amx_config {
	uint8_t palette, start_row, reserved[14];
	uint16_t row_bytes[16];
	uint8_t rows[16];
};

/** All eight tiles whole; a kernel makes those smaller that it needs smaller. */
static inline struct amx_config amx_whole_tiles(void)
{
	struct amx_config config = {.palette = 1};

	for (int i = 0; i < 8; i++) {
		config.rows[i] = 16;
		config.row_bytes[i] = 64;
	}
	return config;
}

/** Between stores and the loading of a tile from there: gcc 12's intrinsic does not tell the
 * compiler that it reads memory. */
static inline void amx_publish(void)
{
	__asm__ volatile("" ::: "memory");
}

#if defined(DVSM_AMX_MODEL)
#include "amx_model.h"
#else

/* By hand: gcc 12's intrinsic does not tell the compiler that the whole of config is read. */
static inline void amx_open(const struct amx_config *config)
{
	__asm__ volatile("ldtilecfg %0" ::"m"(*config) : "memory");
}

static inline void amx_close(void)
{
	_tile_release();
}

#define AMX_ZERO(tile)                 _tile_zero(tile)
#define AMX_LOAD(tile, from, stride)   _tile_loadd(tile, from, (int)(stride))
#define AMX_STREAM(tile, from, stride) _tile_stream_loadd(tile, from, (int)(stride))
#define AMX_STORE(tile, to, stride)    _tile_stored(tile, to, (int)(stride))
#define AMX_DOT_BF16(sums, a, b)       _tile_dpbf16ps(sums, a, b) /* pairs of bfloat16 */
#define AMX_DOT_SIGNED(sums, a, b)     _tile_dpbssd(sums, a, b)   /* fours of signed bytes */
#define AMX_DOT_UNSIGNED(sums, a, b)   _tile_dpbusd(sums, a, b)   /* a's bytes unsigned */

#endif

/**
 * A product that nobody wants, into `sums`: the multiplier falls asleep when it has had nothing to
 * do for about a thousand cycles, and takes some 700 to wake (measured on Emerald Rapids). The
 * three tiles may hold anything.
 */
#define AMX_KEEP_AWAKE(sums, a, b) AMX_DOT_SIGNED(sums, a, b)

#endif
