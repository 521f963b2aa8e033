#include "calibrate.hpp"

#include <algorithm>
#include <cmath>
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

namespace
{

/* Gain of b over a in standard errors, paired by view. */
double gain_in_standard_errors(const std::vector<double> &a, const std::vector<double> &b)
{
	double mean = 0, variance = 0;
	double count = double(a.size());
	for (size_t i = 0; i < a.size(); i++)
		mean += (a[i] - b[i]) / count;
	for (size_t i = 0; i < a.size(); i++)
		variance += std::pow(a[i] - b[i] - mean, 2) / (count - 1);
	double gain = mean / std::sqrt(variance / count);
	return std::isfinite(gain) ? gain : 0;
}

} // namespace

unsigned choose_terms(const Views &views, cv::Size size, unsigned allowed, const Lens &start)
{
	constexpr double kSignificant = 2;
	constexpr size_t kMaxFolds = 10;
	int folds = int(std::min(views.size(), kMaxFolds));
	unsigned chosen = TERMS_NONE;
	std::vector<double> errors = heldout_errors(views, size, chosen, folds, start);
	for (;;) {
		unsigned best = chosen;
		double best_gain = kSignificant;
		std::vector<double> best_errors;
		for (unsigned term : {TERMS_TANGENTIAL, TERMS_K3}) {
			if ((chosen & term) || !(allowed & term))
				continue;
			std::vector<double> richer =
				heldout_errors(views, size, chosen | term, folds, start);
			double gain = gain_in_standard_errors(errors, richer);
			if (gain > best_gain) {
				best = chosen | term;
				best_gain = gain;
				best_errors = richer;
			}
		}
		if (best == chosen)
			return chosen;
		chosen = best;
		errors = best_errors;
	}
}

std::array<double, 9> parameter_sigmas(const Views &views, const Fit &fit)
{
	/* Columns of projectPoints' Jacobian: rotation 3, translation 3, fx fy, cx cy, k1 k2 p1 p2
	 * k3. Poses are eliminated view by view (Schur complement). */
	std::vector<int> columns = {6, 7, 8, 9, 10, 11};
	if (fit.terms & TERMS_TANGENTIAL)
		columns.insert(columns.end(), {12, 13});
	if (fit.terms & TERMS_K3)
		columns.push_back(14);
	int unknowns = int(columns.size());

	cv::Mat information = cv::Mat::zeros(unknowns, unknowns, CV_64F);
	double sum = 0;
	size_t residuals = 0;
	for (size_t i = 0; i < views.size(); i++) {
		cv::Mat projected, jacobian;
		cv::projectPoints(views[i].board, fit.poses[i].rotation, fit.poses[i].translation,
				  fit.lens.matrix, fit.lens.distortion, projected, jacobian);
		cv::Mat of_pose = jacobian.colRange(0, 6);
		cv::Mat of_lens(jacobian.rows, unknowns, CV_64F);
		for (int c = 0; c < unknowns; c++)
			jacobian.col(columns[size_t(c)]).copyTo(of_lens.col(c));
		cv::Mat pose_information = of_pose.t() * of_pose;
		cv::Mat mixed = of_lens.t() * of_pose;
		information += of_lens.t() * of_lens -
			       mixed * pose_information.inv(cv::DECOMP_SVD) * mixed.t();
		sum += fit.poses[i].rms_px * fit.poses[i].rms_px * double(views[i].image.size());
		residuals += 2 * views[i].image.size();
	}
	double freedom = double(residuals) - double(unknowns) - 6.0 * double(views.size());
	cv::Mat covariance = information.inv(cv::DECOMP_SVD) * (sum / std::max(freedom, 1.0));

	std::array<double, 9> sigmas = {};
	for (int c = 0; c < unknowns; c++)
		sigmas[size_t(columns[size_t(c)] - 6)] =
			std::sqrt(std::max(0.0, covariance.at<double>(c, c)));
	return sigmas;
}

} // namespace dio
