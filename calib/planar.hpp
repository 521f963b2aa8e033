/* Pose of a plane from its corners, shared by calibration and tracking. */
#ifndef DIO_CALIB_PLANAR_HPP
#define DIO_CALIB_PLANAR_HPP

#include <vector>

#include <opencv2/core.hpp>

#include "dio/board.h"
#include "dio/geometry.h"

namespace dio
{

/** OpenCV's form of a camera model. */
struct Lens {
	cv::Matx33d matrix = cv::Matx33d::eye();
	cv::Vec<double, 5> distortion;
};

Lens lens_of(const dio_camera_model &model);

/** DIO_BAD_ARG by exception: focal lengths not positive, numbers not finite, size 0. */
void check_model(const dio_camera_model &model, const char *what);

/** Corners of one picture in OpenCV's form. */
struct View {
	std::vector<uint32_t> ids;
	std::vector<cv::Point3f> board;
	std::vector<cv::Point2f> image;
	size_t index = 0; /* of the picture */
};

View view_of(const dio_corners &corners);

/** True when the corners span a plane well enough for a pose: not all near one line. */
bool spans_plane(const View &view);

/** Board frame to camera frame. */
struct PlanarPose {
	cv::Vec3d rotation, translation;
	double rms_px = 0;
};

/**
 * Both solutions of the planar pose problem (IPPE), each refined by Levenberg-Marquardt, the better
 * first; one where both end in the same place. Empty when there is none in front of the camera.
 */
std::vector<PlanarPose> solve_planar(const View &view, const Lens &lens);

double reprojection_rms(const View &view, const Lens &lens, const PlanarPose &pose);

} // namespace dio

#endif
