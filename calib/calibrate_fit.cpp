#include "calibrate.hpp"

#include <limits>

#include <opencv2/calib3d.hpp>

namespace dio
{

Fit fit_views(const Views &views, cv::Size size, unsigned terms, const Lens *start)
{
	std::vector<std::vector<cv::Point3f>> board;
	std::vector<std::vector<cv::Point2f>> image;
	for (const View &view : views) {
		board.push_back(view.board);
		image.push_back(view.image);
	}
	Fit fit;
	fit.terms = terms;
	cv::Mat matrix(cv::Matx33d::eye()), distortion = cv::Mat::zeros(5, 1, CV_64F);
	int flags = cv::CALIB_USE_QR;
	if (start) {
		matrix = cv::Mat(start->matrix).clone();
		distortion = cv::Mat(start->distortion).clone();
		flags |= cv::CALIB_USE_INTRINSIC_GUESS;
	}
	if (!(terms & TERMS_TANGENTIAL)) {
		flags |= cv::CALIB_ZERO_TANGENT_DIST;
		distortion.at<double>(2) = distortion.at<double>(3) = 0;
	}
	if (!(terms & TERMS_K3)) {
		flags |= cv::CALIB_FIX_K3;
		distortion.at<double>(4) = 0;
	}
	std::vector<cv::Mat> rotations, translations;
	fit.rms_px = cv::calibrateCamera(
		board, image, size, matrix, distortion, rotations, translations, flags,
		{cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 60, 1e-7});
	fit.lens.matrix = cv::Matx33d(matrix);
	fit.lens.distortion = cv::Vec<double, 5>(distortion.ptr<double>());
	for (size_t i = 0; i < views.size(); i++) {
		PlanarPose pose;
		pose.rotation = cv::Vec3d(rotations[i].ptr<double>());
		pose.translation = cv::Vec3d(translations[i].ptr<double>());
		pose.rms_px = reprojection_rms(views[i], fit.lens, pose);
		fit.poses.push_back(pose);
	}
	return fit;
}

std::vector<double> heldout_errors(const Views &views, cv::Size size, unsigned terms, int folds,
				   const Lens &start)
{
	std::vector<double> errors(views.size(), std::numeric_limits<double>::infinity());
	for (int fold = 0; fold < folds; fold++) {
		Views rest;
		for (size_t i = 0; i < views.size(); i++)
			if (int(i) % folds != fold)
				rest.push_back(views[i]);
		try {
			Fit fit = fit_views(rest, size, terms, &start);
			for (size_t i = size_t(fold); i < views.size(); i += size_t(folds)) {
				std::vector<PlanarPose> poses = solve_planar(views[i], fit.lens);
				if (!poses.empty())
					errors[i] = poses[0].rms_px * poses[0].rms_px *
						    double(views[i].image.size());
			}
		} catch (const cv::Exception &) {
			/* Too few or degenerate views in this part: its errors stay infinite. */
		}
	}
	return errors;
}

} // namespace dio
