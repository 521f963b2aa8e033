#include "dio/pose.h"

#include <algorithm>
#include <cmath>

#include <opencv2/calib3d.hpp>

#include "guard.hpp"
#include "layout.hpp"
#include "planar.hpp"

namespace dio
{

namespace
{

constexpr uint32_t kMinCorners = 6;

/* Two solutions whose board normals lie closer than this are as good as one. */
constexpr double kSameTiltDeg = 2;

/*
 * The world (z up, origin at the board's centre) and OpenCV's board frame (z into the board, origin
 * at a corner): p_board = diag(1, -1, -1) p_world + centre.
 */
cv::Matx44d board_from_world(const dio_board &board)
{
	cv::Point2d centre = board_centre_m(board);
	return {1, 0, 0, centre.x, 0, -1, 0, centre.y, 0, 0, -1, 0, 0, 0, 0, 1};
}

cv::Matx44d rigid(const cv::Matx33d &r, const cv::Vec3d &t)
{
	return {r(0, 0), r(0, 1), r(0, 2), t[0], r(1, 0), r(1, 1), r(1, 2), t[1],
		r(2, 0), r(2, 1), r(2, 2), t[2], 0,       0,       0,       1};
}

cv::Matx44d rigid_inverse(const cv::Matx44d &m)
{
	cv::Matx33d r = m.get_minor<3, 3>(0, 0).t();
	cv::Vec3d t(m(0, 3), m(1, 3), m(2, 3));
	return rigid(r, -(r * t));
}

double tilt_between_deg(const PlanarPose &a, const PlanarPose &b)
{
	cv::Matx33d ra, rb;
	cv::Rodrigues(a.rotation, ra);
	cv::Rodrigues(b.rotation, rb);
	double cosine = ra(0, 2) * rb(0, 2) + ra(1, 2) * rb(1, 2) + ra(2, 2) * rb(2, 2);
	return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / CV_PI;
}

/*
 * Can the residuals tell the two solutions apart? The gain in squared error must exceed what noise
 * of the better solution's own size explains, 20 units of log likelihood over all corners, since
 * errors of neighbouring corners are alike. Corners are never measured better than 0.1 px.
 */
bool distinguishable(const PlanarPose &best, const PlanarPose &other, size_t corners)
{
	if (tilt_between_deg(best, other) < kSameTiltDeg)
		return true;
	double noise = std::max(best.rms_px, 0.1);
	double gain = other.rms_px * other.rms_px - best.rms_px * best.rms_px;
	return gain > 20.0 / double(corners) * noise * noise;
}

void estimate_pose(const dio_board &board, const dio_camera_model &model,
		   const dio_corners &corners, dio_pose_estimate &estimate)
{
	check_model(model, "pose");
	if (corners.count < kMinCorners)
		fail(DIO_REFUSED, "pose: %u corners of the board, at least %u needed",
		     corners.count, kMinCorners);
	View view = view_of(corners);
	if (!spans_plane(view))
		fail(DIO_REFUSED, "pose: all %u corners lie on a line", corners.count);
	std::vector<PlanarPose> poses = solve_planar(view, lens_of(model));
	if (poses.empty())
		fail(DIO_REFUSED, "pose: no place in front of the camera explains the %u corners",
		     corners.count);
	if (poses.size() > 1 && !distinguishable(poses[0], poses[1], corners.count))
		fail(DIO_REFUSED,
		     "pose: two poses fit alike (%.2f and %.2f px, %.0f degrees apart): come "
		     "nearer or "
		     "look at the board from a slant",
		     poses[0].rms_px, poses[1].rms_px, tilt_between_deg(poses[0], poses[1]));

	cv::Matx33d rotation;
	cv::Rodrigues(poses[0].rotation, rotation);
	cv::Matx44d camera_from_world =
		rigid(rotation, poses[0].translation) * board_from_world(board);
	cv::Matx44d world_from_camera = rigid_inverse(camera_from_world);
	std::copy_n(world_from_camera.val, 16, estimate.pose.world_from_camera);
	estimate.rms_px = poses[0].rms_px;
	estimate.alternative_rms_px = poses.size() > 1 ? poses[1].rms_px : 0;
	estimate.corners = corners.count;
}

void project_board(const dio_board &board, const dio_camera_model &model, const dio_pose &pose,
		   float (*image_px)[2], uint32_t capacity, uint32_t &count)
{
	check_model(model, "board projection");
	CornerGrid grid = corner_grid(board);
	if (capacity < uint32_t(grid.count()))
		fail(DIO_BAD_ARG, "board projection: %d corners, room for %u", grid.count(),
		     capacity);
	cv::Matx44d camera_from_board = rigid_inverse(cv::Matx44d(pose.world_from_camera)) *
					rigid_inverse(board_from_world(board));
	std::vector<cv::Point3d> corners;
	for (int id = 0; id < grid.count(); id++) {
		cv::Point2d place = grid.at(id) * board.square_m;
		cv::Vec4d point = camera_from_board * cv::Vec4d(place.x, place.y, 0, 1);
		if (!(point[2] > 0))
			fail(DIO_BAD_ARG, "board projection: corner %d lies behind the camera", id);
		corners.emplace_back(point[0], point[1], point[2]);
	}
	Lens lens = lens_of(model);
	std::vector<cv::Point2d> projected;
	cv::projectPoints(corners, cv::Vec3d(), cv::Vec3d(), lens.matrix, lens.distortion,
			  projected);
	for (size_t i = 0; i < projected.size(); i++) {
		image_px[i][0] = float(projected[i].x);
		image_px[i][1] = float(projected[i].y);
	}
	count = uint32_t(projected.size());
}

} // namespace

} // namespace dio

extern "C" {

enum dio_status dio_pose_from_corners(const struct dio_board *board,
				      const struct dio_camera_model *model,
				      const struct dio_corners *corners,
				      struct dio_pose_estimate *estimate, struct dio_error *error)
{
	return dio::guarded(error, "pose",
			    [&] { dio::estimate_pose(*board, *model, *corners, *estimate); });
}

enum dio_status dio_pose_project_board(const struct dio_board *board,
				       const struct dio_camera_model *model,
				       const struct dio_pose *pose, float (*image_px)[2],
				       uint32_t capacity, uint32_t *count)
{
	return dio::guarded(nullptr, "board projection", [&] {
		dio::project_board(*board, *model, *pose, image_px, capacity, *count);
	});
}

} // extern "C"
