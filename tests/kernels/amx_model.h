/*
 * AMX in C, as Intel's manual states each instruction (Software Developer's Manual, volume 2):
 * kernels/amx.h includes it in place of the intrinsics. It is stricter than the processor: tiles
 * must be open, and closed once, products must fit each other's shapes.
 */
#ifndef TESTS_KERNELS_AMX_MODEL_H
#define TESTS_KERNELS_AMX_MODEL_H

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#define AMX_MODEL_REQUIRE(condition)                                                               \
	do {                                                                                       \
		if (!(condition)) {                                                                \
			fprintf(stderr, "AMX would fault: %s\n", #condition);                      \
			abort();                                                                   \
		}                                                                                  \
	} while (0)

static _Thread_local struct {
	struct amx_config config;
	bool open;
	uint8_t tiles[8][16][64];
} amx_model;

static inline void amx_open(const struct amx_config *config)
{
	AMX_MODEL_REQUIRE(config->palette == 1 && config->start_row == 0);
	for (int i = 0; i < 8; i++)
		AMX_MODEL_REQUIRE(config->rows[i] <= 16 && config->row_bytes[i] <= 64 &&
				  !config->rows[i] == !config->row_bytes[i]);
	amx_model.config = *config;
	amx_model.open = true;
	memset(amx_model.tiles, 0, sizeof(amx_model.tiles));
}

static inline void amx_close(void)
{
	AMX_MODEL_REQUIRE(amx_model.open);
	amx_model.open = false;
}

static inline void amx_model_zero(int tile)
{
	AMX_MODEL_REQUIRE(amx_model.open && amx_model.config.rows[tile] > 0);
	memset(amx_model.tiles[tile], 0, sizeof(amx_model.tiles[tile]));
}

/* Rows of the tile's own length; what the tile does not have becomes 0. */
static inline void amx_model_load(int tile, const void *from, size_t stride)
{
	amx_model_zero(tile);
	for (int i = 0; i < amx_model.config.rows[tile]; i++)
		memcpy(amx_model.tiles[tile][i], (const uint8_t *)from + (size_t)i * stride,
		       amx_model.config.row_bytes[tile]);
}

static inline void amx_model_store(int tile, void *to, size_t stride)
{
	AMX_MODEL_REQUIRE(amx_model.open && amx_model.config.rows[tile] > 0);
	for (int i = 0; i < amx_model.config.rows[tile]; i++)
		memcpy((uint8_t *)to + (size_t)i * stride, amx_model.tiles[tile][i],
		       amx_model.config.row_bytes[tile]);
}

/* Shapes of sums = sums + a b: m x n, m x k, k x n, in 32-bit elements. */
struct amx_model_shape {
	int m, n, k;
};

static inline struct amx_model_shape amx_model_match(int sums, int a, int b)
{
	const struct amx_config *config = &amx_model.config;

	AMX_MODEL_REQUIRE(amx_model.open && sums != a && sums != b && a != b);
	AMX_MODEL_REQUIRE(config->rows[sums] == config->rows[a]);
	AMX_MODEL_REQUIRE(config->row_bytes[sums] == config->row_bytes[b]);
	AMX_MODEL_REQUIRE(config->row_bytes[a] == 4 * config->rows[b]);
	return (struct amx_model_shape){config->rows[sums], config->row_bytes[sums] / 4,
					config->row_bytes[a] / 4};
}

/* All sixteen columns, so that compilers make vectors of them; those that the tile does not have
 * are 0, as b's are. */
static inline void amx_model_dot_bytes(int sums, int a, int b, bool a_signed)
{
	const struct amx_model_shape shape = amx_model_match(sums, a, b);

	for (int m = 0; m < shape.m; m++) {
		uint32_t row[16];

		memcpy(row, amx_model.tiles[sums][m], sizeof(row));
		for (int k = 0; k < shape.k; k++) {
			const uint8_t *bytes = amx_model.tiles[a][m] + 4 * k;
			const int8_t *column = (const int8_t *)amx_model.tiles[b][k];
			int x[4];

			for (int i = 0; i < 4; i++)
				x[i] = a_signed ? (int8_t)bytes[i] : bytes[i];
			for (int n = 0; n < 16; n++)
				row[n] +=
					(uint32_t)(x[0] * column[4 * n] + x[1] * column[4 * n + 1] +
						   x[2] * column[4 * n + 2] +
						   x[3] * column[4 * n + 3]);
		}
		memcpy(amx_model.tiles[sums][m], row, sizeof(row));
	}
}

/* Numbers below 2^-126 count as 0, before and after. */
static inline float amx_model_flush(float x)
{
	return fabsf(x) < 0x1p-126f ? copysignf(0.0f, x) : x;
}

static inline float amx_model_bf16(const uint8_t *at)
{
	uint32_t bits = (uint32_t)at[0] << 16 | (uint32_t)at[1] << 24;
	float x;

	memcpy(&x, &bits, sizeof(x));
	return amx_model_flush(x);
}

/* TDPBF16PS: the even and the odd places are summed apart, then added, then added to the sums. */
static inline void amx_model_dot_bf16(int sums, int a, int b)
{
	const struct amx_model_shape shape = amx_model_match(sums, a, b);

	for (int m = 0; m < shape.m; m++) {
		float row[16], part[2][16] = {{0}};

		memcpy(row, amx_model.tiles[sums][m], sizeof(row));
		for (int k = 0; k < 2 * shape.k; k++) {
			const float x = amx_model_bf16(&amx_model.tiles[a][m][2 * k]);
			const uint8_t *column = amx_model.tiles[b][k / 2] + k % 2 * 2;
			float *to = part[k % 2];

			for (int n = 0; n < 16; n++)
				to[n] = amx_model_flush(
					fmaf(x, amx_model_bf16(column + 4 * n), to[n]));
		}
		for (int n = 0; n < 16; n++)
			row[n] = amx_model_flush(amx_model_flush(row[n]) +
						 amx_model_flush(part[0][n] + part[1][n]));
		memcpy(amx_model.tiles[sums][m], row, sizeof(row));
	}
}

#define AMX_ZERO(tile)                 amx_model_zero(tile)
#define AMX_LOAD(tile, from, stride)   amx_model_load(tile, from, stride)
#define AMX_STREAM(tile, from, stride) amx_model_load(tile, from, stride)
#define AMX_STORE(tile, to, stride)    amx_model_store(tile, to, stride)
#define AMX_DOT_BF16(sums, a, b)       amx_model_dot_bf16(sums, a, b)
#define AMX_DOT_SIGNED(sums, a, b)     amx_model_dot_bytes(sums, a, b, true)
#define AMX_DOT_UNSIGNED(sums, a, b)   amx_model_dot_bytes(sums, a, b, false)

#endif
