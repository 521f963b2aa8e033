/* Pose from a board in view, undistortion to the engine's pinhole camera, picture metrics. */
#ifndef DIO_POSE_H
#define DIO_POSE_H

#include "dio/board.h"
#include "dio/frame.h"
#include "dio/geometry.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * A pose in the board's world: origin at the board's centre, x along its columns, z up out of the
 * printed side, metres.
 */
struct dio_pose_estimate {
	struct dio_pose pose;
	double rms_px;             /* reprojection error of the pose taken */
	double alternative_rms_px; /* of the other planar solution; 0 when there was none */
	uint32_t corners;
};

/**
 * Pose of the camera from corners: IPPE with both planar solutions judged, then
 * Levenberg-Marquardt refinement.
 *
 * DIO_REFUSED   fewer than 6 corners, all on a line, or the two solutions cannot be told apart
 */
enum dio_status dio_pose_from_corners(const struct dio_board *board,
				      const struct dio_camera_model *model,
				      const struct dio_corners *corners,
				      struct dio_pose_estimate *estimate, struct dio_error *error);

/** Pixel positions of all inner corners of the board seen from a pose, for tests and overlays. */
enum dio_status dio_pose_project_board(const struct dio_board *board,
				       const struct dio_camera_model *model,
				       const struct dio_pose *pose, float (*image_px)[2],
				       uint32_t capacity, uint32_t *count);

/** Opaque: maps of one camera model, made once. Thread-safe to apply. */
struct dio_undistorter;

/**
 * Undistort to a pinhole picture of width x height with square pixels and the principal point at
 * the centre, no invalid border: the largest field of view that is fully covered.
 *
 * pinhole   receives the engine's camera (dist all 0)
 */
enum dio_status dio_undistorter_create(const struct dio_camera_model *model, uint32_t width,
				       uint32_t height, struct dio_camera_model *pinhole,
				       struct dio_undistorter **undistorter,
				       struct dio_error *error);
enum dio_status dio_undistorter_apply(const struct dio_undistorter *undistorter,
				      const struct dio_picture *in, struct dio_picture *out,
				      struct dio_error *error);
void dio_undistorter_destroy(struct dio_undistorter *undistorter);

/**
 * PSNR in dB over all pixels and channels in [0,1] (at most 120), and SSIM on luma (11x11 Gaussian,
 * sigma 1.5, K1 0.01, K2 0.03, reflected borders). Both pictures have the same size.
 */
double dio_metrics_psnr(const struct dio_picture *a, const struct dio_picture *b);
double dio_metrics_ssim(const struct dio_picture *a, const struct dio_picture *b);

#ifdef __cplusplus
}
#endif
#endif
