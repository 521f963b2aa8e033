/* Intrinsics from pictures of a board: fit, what it is worth, and files. */
#ifndef DIO_CALIBRATION_H
#define DIO_CALIBRATION_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/board.h"
#include "dio/geometry.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum dio_view_use {
	DIO_VIEW_USED,
	DIO_VIEW_NO_BOARD,  /* too few corners found */
	DIO_VIEW_OUTLIER,   /* reprojection error far above the others' (robust threshold) */
	DIO_VIEW_DUPLICATE, /* adds no new viewpoint */
};

/** One picture of the calibration. */
struct dio_calibration_view {
	enum dio_view_use use;
	uint32_t corners;
	double rms_px;    /* reprojection error with the final model */
	char reason[160]; /* why it is not used; "" when used */
};

/** Thresholds; dio_calibration_defaults() fills in what the command line uses. */
struct dio_calibration_options {
	uint32_t min_views;       /* used views below this: refused; at least 4 */
	double min_tilt_deg;      /* largest angle between board normals */
	double min_coverage;      /* share of picture cells that hold a corner, [0,1] */
	double max_heldout_ratio; /* held-out RMS / fit RMS above this: refused */
	bool fix_k3;              /* k3 = 0 whatever the views say */

	/* Asked between the steps of the fit; false ends it: DIO_REFUSED, "cancelled". NULL: it is
	 * never asked. */
	bool (*keep_going)(void *context);
	void *context;
};
void dio_calibration_defaults(struct dio_calibration_options *options);

/**
 * The result. Of the distortion, k1 and k2 are always estimated; p1 with p2, and k3, where the
 * views give evidence for them (BIC), else they are 0.
 *
 * Sigmas are one standard deviation, from the covariance of a fit with all terms: errors that a
 * view's corners share are accounted for, and so is the doubt about a term that was left out, whose
 * own sigma says how far from 0 it may be. A sigma of 0: the caller fixed the term.
 */
struct dio_calibration {
	struct dio_camera_model model;
	double sigma_fx, sigma_fy, sigma_cx, sigma_cy, sigma_dist[5];
	double rms_px;         /* over the used corners */
	double heldout_rms_px; /* fit on one half of the views, tested on the other, both ways */
	double coverage;       /* share of a grid of picture cells with at least one corner */
	double tilt_deg;       /* largest angle between two board normals */
	uint32_t views_used, views_total;
	enum dio_board_layout layout;
	struct dio_calibration_view
		*views; /* [views_total]; release with dio_calibration_deinit() */
};

/**
 * Calibrate from the corners of several pictures of one size.
 *
 * corners       [count], as dio_board_detect() made them (count 0 entries allowed)
 * calibration   zero-initialised; views[] is filled even when the answer is DIO_REFUSED, so that
 *               a caller can say which pictures were of use
 *
 * options       NULL for the defaults
 *
 * DIO_REFUSED   too few views, too little tilt or coverage, held-out error far above the fit, a
 * focal length known to worse than 5 percent, more than a third of the views contradicting the
 * rest, an RMS above 0.2 percent of the picture's diagonal DIO_BAD_ARG   corners that are not
 * finite
 */
enum dio_status dio_calibrate(const struct dio_board *board, const struct dio_corners *corners,
			      uint32_t count, uint32_t width, uint32_t height,
			      const struct dio_calibration_options *options,
			      struct dio_calibration *calibration, struct dio_error *error);
void dio_calibration_deinit(struct dio_calibration *calibration);

/**
 * OpenCV YAML (cv::FileStorage) or ROS camera_info YAML, told apart by content.
 *
 * DIO_BAD_FILE     the line names the file and the key
 * DIO_UNSUPPORTED  a distortion model beyond k1 k2 p1 p2 k3
 */
enum dio_status dio_camera_model_read(const char *path, struct dio_camera_model *model,
				      struct dio_error *error);

enum dio_camera_file { DIO_CAMERA_FILE_OPENCV, DIO_CAMERA_FILE_ROS };

/** Write beside, sync, rename. `calibration` is NULL or adds RMS, sigmas and the rest as comments
 * or nodes. */
enum dio_status dio_camera_model_write(const char *path, enum dio_camera_file kind,
				       const struct dio_camera_model *model,
				       const struct dio_calibration *calibration,
				       struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
