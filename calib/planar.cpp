#include "planar.hpp"

#include <algorithm>
#include <cmath>

#include <opencv2/calib3d.hpp>

#include "guard.hpp"

namespace dio
{

Lens lens_of(const dio_camera_model &model)
{
	Lens lens;
	lens.matrix = {model.fx, 0, model.cx, 0, model.fy, model.cy, 0, 0, 1};
	lens.distortion = cv::Vec<double, 5>(model.dist);
	return lens;
}

void check_model(const dio_camera_model &model, const char *what)
{
	if (model.width == 0 || model.height == 0 || model.width > 65536 || model.height > 65536)
		fail(DIO_BAD_ARG, "%s: the camera model states a picture of %ux%u pixels", what,
		     model.width, model.height);
	if (!(model.fx > 0) || !(model.fy > 0) || !std::isfinite(model.fx) ||
	    !std::isfinite(model.fy))
		fail(DIO_BAD_ARG, "%s: the camera model's focal length %g, %g is not positive",
		     what, model.fx, model.fy);
	if (!std::isfinite(model.cx) || !std::isfinite(model.cy))
		fail(DIO_BAD_ARG, "%s: the camera model's principal point is not finite", what);
	for (double coefficient : model.dist)
		if (!std::isfinite(coefficient))
			fail(DIO_BAD_ARG, "%s: the camera model's distortion is not finite", what);
}

View view_of(const dio_corners &corners)
{
	View view;
	for (uint32_t i = 0; i < corners.count; i++) {
		const double *place = corners.board_m[i];
		const float *pixel = corners.image_px[i];
		if (!std::isfinite(pixel[0]) || !std::isfinite(pixel[1]))
			fail(DIO_BAD_ARG, "corners: corner %u of %u is not finite", i,
			     corners.count);
		view.ids.push_back(corners.ids[i]);
		view.board.emplace_back(float(place[0]), float(place[1]), float(place[2]));
		view.image.emplace_back(pixel[0], pixel[1]);
	}
	return view;
}

bool spans_plane(const View &view)
{
	cv::Point2d mean(0, 0);
	for (const cv::Point3f &point : view.board)
		mean += cv::Point2d(point.x, point.y) / double(view.board.size());
	double xx = 0, xy = 0, yy = 0;
	for (const cv::Point3f &point : view.board) {
		cv::Point2d away = cv::Point2d(point.x, point.y) - mean;
		xx += away.x * away.x;
		xy += away.x * away.y;
		yy += away.y * away.y;
	}
	/* The smaller variance of the two principal axes against the larger. */
	double half = (xx + yy) / 2, split = std::hypot((xx - yy) / 2, xy);
	return half > 0 && half - split > 0.01 * (half + split);
}

double reprojection_rms(const View &view, const Lens &lens, const PlanarPose &pose)
{
	std::vector<cv::Point2f> projected;
	cv::projectPoints(view.board, pose.rotation, pose.translation, lens.matrix, lens.distortion,
			  projected);
	double sum = 0;
	for (size_t i = 0; i < projected.size(); i++) {
		cv::Point2f miss = projected[i] - view.image[i];
		sum += double(miss.x) * miss.x + double(miss.y) * miss.y;
	}
	return std::sqrt(sum / double(projected.size()));
}

namespace
{

/* Every corner in front of the camera, every number finite. */
bool in_front(const View &view, const PlanarPose &pose)
{
	cv::Matx33d rotation;
	cv::Rodrigues(pose.rotation, rotation);
	for (const cv::Point3f &point : view.board) {
		cv::Vec3d place =
			rotation * cv::Vec3d(point.x, point.y, point.z) + pose.translation;
		if (!(place[2] > 0) || !std::isfinite(place[0]) || !std::isfinite(place[1]) ||
		    !std::isfinite(place[2]))
			return false;
	}
	return std::isfinite(pose.rms_px);
}

bool same_pose(const PlanarPose &a, const PlanarPose &b)
{
	cv::Matx33d ra, rb;
	cv::Rodrigues(a.rotation, ra);
	cv::Rodrigues(b.rotation, rb);
	return cv::norm(ra - rb) < 1e-3 &&
	       cv::norm(a.translation - b.translation) < 1e-3 * cv::norm(a.translation);
}

} // namespace

namespace
{

/* Both IPPE solutions, refined, with the board turned in its plane by `turn_rad` while solving. */
std::vector<PlanarPose> solve_turned(const View &view, const Lens &lens, double turn_rad)
{
	double c = std::cos(turn_rad), s = std::sin(turn_rad);
	cv::Matx33d turn(c, -s, 0, s, c, 0, 0, 0, 1);
	std::vector<cv::Point3d> board;
	for (const cv::Point3f &point : view.board)
		board.emplace_back(turn * cv::Point3d(point));
	std::vector<cv::Point2d> image(view.image.begin(), view.image.end());
	std::vector<cv::Mat> rotations, translations;
	cv::solvePnPGeneric(board, image, lens.matrix, lens.distortion, rotations, translations,
			    false, cv::SOLVEPNP_IPPE);

	std::vector<PlanarPose> poses;
	for (size_t i = 0; i < rotations.size(); i++) {
		if (!cv::checkRange(rotations[i]) || !cv::checkRange(translations[i]))
			continue;
		cv::Matx33d rotation;
		cv::Rodrigues(rotations[i], rotation);
		PlanarPose pose;
		cv::Rodrigues(rotation * turn, pose.rotation);
		pose.translation = cv::Vec3d(translations[i].ptr<double>());
		cv::Mat refined_rotation(pose.rotation, false),
			refined_translation(pose.translation, false);
		cv::solvePnPRefineLM(view.board, view.image, lens.matrix, lens.distortion,
				     refined_rotation, refined_translation,
				     {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-12});
		pose.rms_px = reprojection_rms(view, lens, pose);
		if (in_front(view, pose))
			poses.push_back(pose);
	}
	return poses;
}

} // namespace

std::vector<PlanarPose> solve_planar(const View &view, const Lens &lens)
{
	/* A board whose axis lies along the picture's can make IPPE divide by nothing. */
	std::vector<PlanarPose> poses;
	for (double turn_rad : {0.0, 0.7, 2.0})
		if (poses.empty())
			poses = solve_turned(view, lens, turn_rad);
	std::sort(poses.begin(), poses.end(),
		  [](const PlanarPose &a, const PlanarPose &b) { return a.rms_px < b.rms_px; });
	if (poses.size() > 1 && same_pose(poses[0], poses[1]))
		poses.resize(1);
	return poses;
}

} // namespace dio
