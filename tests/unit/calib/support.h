/* What the calibration tests share: real sets on disk and synthetic pictures of a board. */
#ifndef DIO_TESTS_CALIB_SUPPORT_H
#define DIO_TESTS_CALIB_SUPPORT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dio/board.h"
#include "dio/calibration.h"
#include "dio/geometry.h"
#include "dio/pose.h"

/** The corners of every picture of a set, in the order of their names. */
struct corner_set {
	struct dio_board board; /* with the layout decided */
	struct dio_corners *corners;
	uint32_t count, width, height;
};

/** A folder of the shared data, or NULL with a printed reason when it is not there. */
const char *shared_folder(const char *path, char *buffer, size_t size);

/** Detect the board in every file of `folder` whose name starts with `prefix`. Fails the test on
 * error. */
void corner_set_load(struct corner_set *set, const char *spec, const char *folder,
		     const char *prefix);
void corner_set_free(struct corner_set *set);

/** Camera at `eye` (world of dio/pose.h, metres) looking at `target`, top towards world +y, turned
 * by roll_deg. */
struct dio_pose look_at(const double eye[3], const double target[3], double roll_deg);

/** A camera on a sphere around the board's centre; elevation 90 is straight above. */
struct dio_pose orbit(double azimuth_deg, double elevation_deg, double distance_m, double roll_deg);

/** Draw the board as a camera sees it, distortion included, antialiased, on a grey table. */
void render_board(const struct dio_board *board, const struct dio_camera_model *model,
		  const struct dio_pose *pose, struct dio_picture *picture);

/** Normal deviates, seeded. */
double noise(uint64_t *seed);

/**
 * Corners as a perfect detector would find them, plus noise of sigma_px on each axis; those outside
 * the picture are left out.
 */
void project_corners(const struct dio_board *board, const struct dio_camera_model *model,
		     const struct dio_pose *pose, double sigma_px, uint64_t *seed,
		     struct dio_corners *corners);

/** Parse a specification that must be right. */
struct dio_board board_of(const char *spec);

#endif
