/* A 32 x 32 block of a product in four AMX accumulators, and who may use them (tiles.h). */
#pragma once

#include <cpuid.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/syscall.h>
#include <unistd.h>

/* The intrinsics of gcc 12 do not tell it that tiles read and write memory; these do. */
#define TILE_LOAD(tile, base, stride)                                                              \
	__asm__ volatile("tileloadd (%0,%1,1), %%tmm" #tile ::"r"(base), "r"((long)(stride))       \
			 : "memory")
#define TILE_STORE(tile, base, stride)                                                             \
	__asm__ volatile("tilestored %%tmm" #tile ", (%0,%1,1)" ::"r"(base), "r"((long)(stride))   \
			 : "memory")
#define TILE_ZERO(tile)   __asm__ volatile("tilezero %%tmm" #tile ::)
#define TILE_DOT(c, a, b) __asm__ volatile("tdpbf16ps %%tmm" #b ", %%tmm" #a ", %%tmm" #c ::)

/* Eight tiles of 16 rows of 64 bytes, for the calling thread. */
static inline void tiles_configure(void)
{
	_Alignas(64) uint8_t config[64] = {[0] = 1};
	for (int i = 0; i < 8; i++) {
		config[16 + 2 * i] = 64;
		config[48 + i] = 16;
	}
	__asm__ volatile("ldtilecfg %0" ::"m"(config) : "memory");
}

static inline void tiles_release(void)
{
	__asm__ volatile("tilerelease" ::: "memory");
}

/* The processor has AMX with bfloat16 and AVX-512 with bfloat16, and the kernel lets us use them.
 */
static inline bool tiles_supported(void)
{
	enum { REQUEST_PERMISSION = 0x1023, TILE_DATA = 18 };
	unsigned a, b, c, d;
	if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(d >> 22 & 1) || !(d >> 24 & 1)) {
		return false;
	}
	if (!(b >> 16 & 1) || !(b >> 30 & 1) || !__get_cpuid_count(7, 1, &a, &b, &c, &d) ||
	    !(a >> 5 & 1)) {
		return false;
	}
	return syscall(SYS_arch_prctl, REQUEST_PERMISSION, TILE_DATA) == 0;
}

static inline void tiles_zero(void)
{
	TILE_ZERO(0);
	TILE_ZERO(1);
	TILE_ZERO(2);
	TILE_ZERO(3);
}

static inline void tiles_load(const float *c, long stride)
{
	TILE_LOAD(0, c, stride);
	TILE_LOAD(1, c + 16, stride);
	TILE_LOAD(2, (const char *)c + 16 * stride, stride);
	TILE_LOAD(3, (const char *)(c + 16) + 16 * stride, stride);
}

static inline void tiles_store(float *c, long stride)
{
	TILE_STORE(0, c, stride);
	TILE_STORE(1, c + 16, stride);
	TILE_STORE(2, (char *)c + 16 * stride, stride);
	TILE_STORE(3, (char *)(c + 16) + 16 * stride, stride);
}

/*
 * Add `steps` products of 32 x 32 to the accumulators. Rows 0-15 of the left factor start at a0,
 * rows 16-31 at a1, `stride` bytes apart; the next step's lie `advance` bytes on. The right factor
 * is a packed panel: two tiles a step.
 */
static inline void tiles_multiply(const void *a0, const void *a1, long stride, long advance,
				  const uint16_t *panel, int steps)
{
	const char *first = a0, *second = a1;
	for (int i = 0; i < steps; i++, first += advance, second += advance, panel += 1024) {
		TILE_LOAD(6, panel, 64);
		TILE_LOAD(4, first, stride);
		TILE_DOT(0, 4, 6);
		TILE_LOAD(7, panel + 512, 64);
		TILE_DOT(1, 4, 7);
		TILE_LOAD(5, second, stride);
		TILE_DOT(2, 5, 6);
		TILE_DOT(3, 5, 7);
	}
}
