/* What storing a picture as JPEG does to it, without the file. */
#ifndef DIO_SIM_JPEG_H
#define DIO_SIM_JPEG_H

#include "vec.h"

enum { SIM_JPEG_SQUARE = 16 };

/* Tables of ITU T.81 annex K, for brightness and colour. */
DIO_SIM_CONST uint8_t sim_jpeg_steps[2][64] = {
	{16, 11, 10, 16, 24,  40,  51,  61,  12, 12, 14, 19, 26,  58,  60,  55,
	 14, 13, 16, 24, 40,  57,  69,  56,  14, 17, 22, 29, 51,  87,  80,  62,
	 18, 22, 37, 56, 68,  109, 103, 77,  24, 35, 55, 64, 81,  104, 113, 92,
	 49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99},
	{17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99,
	 99, 99, 47, 66, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
	 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99},
};

/* cos((2 x + 1) k pi / 16) / 2, and its first row over sqrt(2): the orthonormal transform. */
DIO_SIM_CONST float sim_dct[8][8] = {
	{0.353553391f, 0.353553391f, 0.353553391f, 0.353553391f, 0.353553391f, 0.353553391f,
	 0.353553391f, 0.353553391f},
	{0.490392640f, 0.415734806f, 0.277785117f, 0.097545161f, -0.097545161f, -0.277785117f,
	 -0.415734806f, -0.490392640f},
	{0.461939766f, 0.191341716f, -0.191341716f, -0.461939766f, -0.461939766f, -0.191341716f,
	 0.191341716f, 0.461939766f},
	{0.415734806f, -0.097545161f, -0.490392640f, -0.277785117f, 0.277785117f, 0.490392640f,
	 0.097545161f, -0.415734806f},
	{0.353553391f, -0.353553391f, -0.353553391f, 0.353553391f, 0.353553391f, -0.353553391f,
	 -0.353553391f, 0.353553391f},
	{0.277785117f, -0.490392640f, 0.097545161f, 0.415734806f, -0.415734806f, -0.097545161f,
	 0.490392640f, -0.277785117f},
	{0.191341716f, -0.461939766f, 0.461939766f, -0.191341716f, -0.191341716f, 0.461939766f,
	 -0.461939766f, 0.191341716f},
	{0.097545161f, -0.277785117f, 0.415734806f, -0.490392640f, 0.490392640f, -0.415734806f,
	 0.277785117f, -0.097545161f},
};

/* Step between the levels of a coefficient at a quality of 1..100, as libjpeg scales them. */
DIO_SIM_FN float jpeg_step(uint32_t colour, uint32_t place, float quality)
{
	float q = clampf(quality, 1, 100),
	      scale = q < 50 ? (float)floor_int(5000 / q) : 200 - 2 * q;

	return clampf((float)floor_int((sim_jpeg_steps[colour][place] * scale + 50) * 0.01f), 1,
		      255);
}

/* One block of 8 x 8 values about 0 (bytes less 128), transformed, rounded and back, in place. */
DIO_SIM_FN void jpeg_block(float *block, uint32_t colour, float quality)
{
	float half[64], sum;

	for (uint32_t i = 0; i < 64; i++) { /* across */
		sum = 0;
		for (uint32_t x = 0; x < 8; x++)
			sum += sim_dct[i % 8][x] * block[i / 8 * 8 + x];
		half[i] = sum;
	}
	for (uint32_t i = 0; i < 64; i++) { /* down */
		float step = jpeg_step(colour, i, quality);

		sum = 0;
		for (uint32_t y = 0; y < 8; y++)
			sum += sim_dct[i / 8][y] * half[8 * y + i % 8];
		block[i] = (float)floor_int(sum / step + 0.5f) * step;
	}
	for (uint32_t i = 0; i < 64; i++) { /* and back */
		sum = 0;
		for (uint32_t y = 0; y < 8; y++)
			sum += sim_dct[y][i / 8] * block[8 * y + i % 8];
		half[i] = sum;
	}
	for (uint32_t i = 0; i < 64; i++) {
		sum = 0;
		for (uint32_t x = 0; x < 8; x++)
			sum += sim_dct[x][i % 8] * half[i / 8 * 8 + x];
		block[i] = sum;
	}
}

/* Whole levels, as files keep them between the steps. */
DIO_SIM_FN float jpeg_level(float x)
{
	return (float)floor_int(x + 0.5f);
}

/* A square of 16 x 16 pixels from (x0, y0) on, in place: brightness in four blocks, the two colour
 * differences at half the size in one each (4:2:0). Values in [0, 1]; past the picture's edge its
 * last pixels go on. `width` and `height` of the picture rgb[height][width][3]. */
DIO_SIM_FN void jpeg_square(float *rgb, uint32_t width, uint32_t height, uint32_t x0, uint32_t y0,
			    float quality)
{
	float luma[4][64], blue[64], red[64];

	for (uint32_t i = 0; i < 64; i++)
		blue[i] = red[i] = 0;
	for (uint32_t i = 0; i < 256; i++) {
		uint32_t x = x0 + i % 16, y = y0 + i / 16;
		uint32_t block = i / 128 * 2 + i % 16 / 8, place = i / 16 % 8 * 8 + i % 8;
		uint32_t shared = i / 32 * 8 + i % 16 / 2;
		const float *from = rgb + 3 * ((size_t)(y < height ? y : height - 1) * width +
					       (x < width ? x : width - 1));
		float r = jpeg_level(255 * from[0]), g = jpeg_level(255 * from[1]),
		      b = jpeg_level(255 * from[2]);

		luma[block][place] = jpeg_level(0.299f * r + 0.587f * g + 0.114f * b) - 128;
		blue[shared] += jpeg_level(-0.168735892f * r - 0.331264108f * g + 0.5f * b);
		red[shared] += jpeg_level(0.5f * r - 0.418687589f * g - 0.081312411f * b);
	}
	for (uint32_t i = 0; i < 64; i++) {
		blue[i] = jpeg_level(0.25f * blue[i]);
		red[i] = jpeg_level(0.25f * red[i]);
	}
	for (uint32_t i = 0; i < 4; i++)
		jpeg_block(luma[i], 0, quality);
	jpeg_block(blue, 1, quality);
	jpeg_block(red, 1, quality);
	for (uint32_t i = 0; i < 256; i++) {
		uint32_t x = x0 + i % 16, y = y0 + i / 16;
		uint32_t block = i / 128 * 2 + i % 16 / 8, place = i / 16 % 8 * 8 + i % 8;
		uint32_t shared = i / 32 * 8 + i % 16 / 2;
		float v = jpeg_level(luma[block][place]) + 128;
		float b = jpeg_level(blue[shared]), r = jpeg_level(red[shared]);
		float *to = rgb + 3 * ((size_t)y * width + x);

		if (x >= width || y >= height)
			continue;
		to[0] = saturate((v + 1.402f * r) * (1.0f / 255));
		to[1] = saturate((v - 0.344136f * b - 0.714136f * r) * (1.0f / 255));
		to[2] = saturate((v + 1.772f * b) * (1.0f / 255));
	}
}

#endif
