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
 * printed side, metres. With c the centre in the board frame (dio/board.h, z into the board):
 *
 *     p_board = diag(1, -1, -1) p_world + c
 *
 * c = (cols s / 2, rows s / 2, 0) for a ChArUco board of cols x rows squares of side s, and
 * ((cols - 1) s / 2, (rows - 1) s / 2, 0) for a chessboard of cols x rows inner corners.
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

/**
 * Pixel positions of all inner corners of the board seen from a pose, for tests and overlays, in
 * the order of their ids.
 *
 * DIO_BAD_ARG   capacity too small, or a corner behind the camera
 */
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
 * Smaller pictures are averaged, not sampled, so that they do not alias.
 *
 * pinhole       receives the engine's camera (dist all 0)
 * undistorter   release with dio_undistorter_destroy()
 *
 * DIO_BAD_ARG   a size of 0 or above 8192, a model without a positive focal length, a principal
 *               point outside its picture
 */
enum dio_status dio_undistorter_create(const struct dio_camera_model *model, uint32_t width,
				       uint32_t height, struct dio_camera_model *pinhole,
				       struct dio_undistorter **undistorter,
				       struct dio_error *error);

/**
 * out   zero-initialised or a picture from an earlier call, whose memory is used again; not `in`
 *
 * DIO_BAD_ARG   `in` is not of the size the camera model states
 */
enum dio_status dio_undistorter_apply(const struct dio_undistorter *undistorter,
				      const struct dio_picture *in, struct dio_picture *out,
				      struct dio_error *error);
void dio_undistorter_destroy(struct dio_undistorter *undistorter);

/**
 * PSNR in dB over all pixels and channels in [0,1] (at most 120), and SSIM on luma (11x11 Gaussian,
 * sigma 1.5, K1 0.01, K2 0.03, reflected borders). NaN when the pictures differ in size.
 */
double dio_metrics_psnr(const struct dio_picture *a, const struct dio_picture *b);
double dio_metrics_ssim(const struct dio_picture *a, const struct dio_picture *b);

#ifdef __cplusplus
}
#endif
#endif
