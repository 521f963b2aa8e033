/* Simulated camera: ray-traced procedural scenes with true poses and intrinsics.
 * A library of its own (libc and libm only): training draws its scenes from here too. */
#ifndef DIO_SIM_H
#define DIO_SIM_H

#include <stdbool.h>
#include <stdint.h>

#if defined(__GNUC__)
#define DIO_SIM_API __attribute__((visibility("default")))
#else
#define DIO_SIM_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/** Opaque, immutable once made: many threads may render one scene. */
struct dio_sim_scene;

enum dio_sim_kind {
	DIO_SIM_TABLE,     /* textured boxes, balls, cylinders on a textured table */
	DIO_SIM_ROOM,      /* inside four walls */
	DIO_SIM_TURNTABLE, /* one object before a plain white, grey or black backdrop */
	DIO_SIM_STREET,    /* house fronts, walls and monuments out of doors */
};

/**
 * A ChArUco board printed on paper with a white margin of 0.6 squares, lying on the table, its
 * centre at the world's origin. Seen from above with x to the right and y up it reads upright: its
 * top left square is at x = -cols / 2 * square_m, y = +rows / 2 * square_m.
 */
struct dio_sim_board {
	uint32_t cols, rows; /* squares; 0: no board. Markers are DICT_6X6_250 from 0;
			      * past the dictionary's end white squares stay empty */
	double square_m, marker_m;
	bool legacy; /* layout of OpenCV < 4.6 for even rows */
};

struct dio_sim_scene_options {
	uint64_t seed;
	enum dio_sim_kind kind;
	struct dio_sim_board board;
	bool clear_board; /* keep objects off the board */
};

/** World: metres, z up, table top at z = 0. NULL when memory is short. */
DIO_SIM_API struct dio_sim_scene *dio_sim_scene_create(const struct dio_sim_scene_options *options);
DIO_SIM_API void dio_sim_scene_destroy(struct dio_sim_scene *scene);

/**
 * Photographs that scenes made from now on print on boxes, books, walls and pictures.
 *
 * pixels  [count][side][side][3] bytes sRGB, copied
 * side    a power of two, 4096 at most
 * count   0 forgets them all
 *
 * For the whole process, and not while scenes exist that were made with other photographs.
 * 0, or -1 when memory is short or the side is not as said
 */
DIO_SIM_API int dio_sim_photos_set(const uint8_t *pixels, uint32_t side, uint32_t count);

/** True camera: OpenCV axes and distortion (k1, k2, p1, p2, k3), pixel (0,0) at a pixel's centre.
 */
struct dio_sim_camera {
	uint32_t width, height;
	double fx, fy, cx, cy;
	double dist[5];
	double world_from_camera[16];
};

/** What the sensor does to light; zero-initialised is a perfect sensor. */
struct dio_sim_sensor {
	float exposure_stops;   /* +1 doubles */
	float white_balance[3]; /* gains; 0 means 1 */
	float noise;            /* standard deviation of read noise, in [0,1] of the picture */
	float shot_noise;       /* the same at full scale, less in the dark */
	float blur_px;          /* Gaussian */
	float vignetting;       /* loss of light in the corners, [0,1] */
	uint64_t noise_seed;
	float jpeg_quality; /* 1..100 as libjpeg counts, 4:2:0; 0: not compressed */
};

/**
 * Render. Deterministic: same arguments, same bytes, with any compiler, on any number of threads.
 *
 * sensor    NULL: a perfect one
 * samples   1..8: a pixel that differs from its neighbours gets samples x samples rays, others one
 * rgb       [height][width][3] bytes sRGB, caller's memory
 *
 * false when memory is short; rgb then holds nothing of use
 */
DIO_SIM_API bool dio_sim_render(const struct dio_sim_scene *scene,
				const struct dio_sim_camera *camera,
				const struct dio_sim_sensor *sensor, uint32_t samples,
				uint8_t *rgb);

/** Same picture, sRGB-encoded floats in [0,1] before noise, JPEG and rounding. */
DIO_SIM_API bool dio_sim_render_float(const struct dio_sim_scene *scene,
				      const struct dio_sim_camera *camera,
				      const struct dio_sim_sensor *sensor, uint32_t samples,
				      float *rgb);

/**
 * A moving viewpoint around the scene, at time t in seconds: position, direction, hand shake;
 * the board stays in view when the scene has one. `style` 0: a slow walk round (capture),
 * 1: a calibration dance (close, far, tilted, into the corners).
 */
DIO_SIM_API void dio_sim_viewpoint(const struct dio_sim_scene *scene, uint32_t style, double time_s,
				   double world_from_camera[16]);

#ifdef __cplusplus
}
#endif
#endif
