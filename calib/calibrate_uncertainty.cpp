/*
 * What a fit knows of its parameters, and which distortion terms the views call for.
 *
 * Left out, a term that is really there moves the others, the principal point above all, by many of
 * the sigmas that a fit without it states: such a fit takes for granted what it never looked at.
 * Everything here therefore comes from the fit with all terms the caller allows.
 */
#include "calibrate.hpp"

#include <algorithm>
#include <cmath>

#include <opencv2/calib3d.hpp>

namespace dio
{

namespace
{

/* Places in Parameters. */
constexpr int kParameters = 9;
constexpr int kTangential[] = {6, 7};
constexpr int kThirdRadial[] = {8};

std::vector<int> estimated(unsigned terms)
{
	std::vector<int> places = {0, 1, 2, 3, 4, 5};
	if (terms & TERMS_TANGENTIAL)
		places.insert(places.end(), std::begin(kTangential), std::end(kTangential));
	if (terms & TERMS_K3)
		places.insert(places.end(), std::begin(kThirdRadial), std::end(kThirdRadial));
	return places;
}

/* What one view says of the lens once its pose is fitted to it (Schur complement). */
struct ViewShare {
	cv::Mat information; /* J' J, its pose projected out */
	cv::Mat gradient;    /* J' residuals */
	double squares = 0;
};

ViewShare share_of(const View &view, const Lens &lens, const PlanarPose &pose,
		   const std::vector<int> &places)
{
	std::vector<cv::Point2d> projected;
	cv::Mat jacobian;
	std::vector<cv::Point3d> board(view.board.begin(), view.board.end());
	cv::projectPoints(board, pose.rotation, pose.translation, lens.matrix, lens.distortion,
			  projected, jacobian);
	cv::Mat residuals(jacobian.rows, 1, CV_64F);
	for (size_t i = 0; i < projected.size(); i++) {
		residuals.at<double>(int(2 * i)) = view.image[i].x - projected[i].x;
		residuals.at<double>(int(2 * i) + 1) = view.image[i].y - projected[i].y;
	}
	/* Columns: rotation 3, translation 3, then fx fy cx cy k1 k2 p1 p2 k3. */
	cv::Mat of_pose = jacobian.colRange(0, 6);
	cv::Mat of_lens(jacobian.rows, int(places.size()), CV_64F);
	for (size_t c = 0; c < places.size(); c++)
		jacobian.col(6 + places[c]).copyTo(of_lens.col(int(c)));
	cv::Mat pose_information = of_pose.t() * of_pose;
	of_lens -= of_pose * (pose_information.inv(cv::DECOMP_SVD) * (of_pose.t() * of_lens));
	return {of_lens.t() * of_lens, of_lens.t() * residuals, residuals.dot(residuals)};
}

/*
 * How much more the views disagree over the lens than errors independent from corner to corner
 * would make them. A board that bends or a light that turns moves all corners of a view together:
 * then there are fewer independent measurements than corners. The views' gradients, whose sum is
 * zero, are held against the scatter they would have, sigma^2 (A_i - A_i A^-1 A_i) for a view's
 * share A_i of the information A; one figure pooled over all parameters, as a dozen views cannot
 * support a matrix.
 */
double view_dispersion(const std::vector<ViewShare> &shares, const cv::Mat &inverse,
		       double variance)
{
	double scatter = 0, expected = inverse.rows;
	for (const ViewShare &share : shares) {
		cv::Mat weight = inverse * share.information;
		scatter += share.gradient.dot(inverse * share.gradient);
		expected -= cv::trace(weight * weight)[0];
	}
	double dispersion = scatter / (variance * expected);
	return std::isfinite(dispersion) ? std::max(1.0, dispersion) : 1;
}

/* Inverse of a covariance or information, scaled first: k3 and fx are a million apart. */
cv::Mat invert(const cv::Mat &matrix)
{
	cv::Mat scale(matrix.rows, 1, CV_64F);
	for (int i = 0; i < matrix.rows; i++)
		scale.at<double>(i) = 1 / std::sqrt(std::max(matrix.at<double>(i, i), 1e-300));
	cv::Mat scales = scale * scale.t();
	cv::Mat scaled = matrix.mul(scales);
	return cv::Mat(scaled.inv(cv::DECOMP_SVD)).mul(scales);
}

/* theta' V^-1 theta of the terms at these places: what leaving them out costs, in sigmas squared.
 */
double cost_without(const Lens &lens, const Covariance &covariance, const std::vector<int> &places)
{
	int count = int(places.size());
	cv::Mat theta(count, 1, CV_64F), block(count, count, CV_64F);
	for (int i = 0; i < count; i++) {
		theta.at<double>(i) = lens.distortion[places[size_t(i)] - 4];
		for (int j = 0; j < count; j++)
			block.at<double>(i, j) = covariance(places[size_t(i)], places[size_t(j)]);
	}
	return count ? theta.dot(invert(block) * theta) : 0;
}

Parameters parameters_of(const Lens &lens)
{
	Parameters all;
	all(0) = lens.matrix(0, 0);
	all(1) = lens.matrix(1, 1);
	all(2) = lens.matrix(0, 2);
	all(3) = lens.matrix(1, 2);
	for (int i = 0; i < 5; i++)
		all(4 + i) = lens.distortion[i];
	return all;
}

} // namespace

Uncertainty uncertainty_of(const Views &views, const Fit &fit)
{
	std::vector<int> places = estimated(fit.terms);
	int unknowns = int(places.size());
	cv::Mat information = cv::Mat::zeros(unknowns, unknowns, CV_64F);
	std::vector<ViewShare> shares;
	double squares = 0, measured = 0;
	for (size_t i = 0; i < views.size(); i++) {
		shares.push_back(share_of(views[i], fit.lens, fit.poses[i], places));
		information += shares.back().information;
		squares += shares.back().squares;
		measured += 2 * double(views[i].image.size());
	}
	double freedom = measured - unknowns - 6.0 * double(views.size());
	double variance = squares / std::max(freedom, 1.0);
	cv::Mat inverse = invert(information);
	double dispersion = view_dispersion(shares, inverse, variance);

	Uncertainty uncertainty;
	uncertainty.measurements = measured / dispersion;
	for (int i = 0; i < unknowns; i++)
		for (int j = 0; j < unknowns; j++)
			uncertainty.covariance(places[size_t(i)], places[size_t(j)]) =
				variance * dispersion * inverse.at<double>(i, j);
	return uncertainty;
}

unsigned choose_terms(const Fit &fullest, const Uncertainty &uncertainty)
{
	double price = std::log(std::max(uncertainty.measurements, 1.0));
	unsigned chosen = fullest.terms;
	double least = 0;
	for (unsigned terms = 0; terms < fullest.terms; terms++) {
		if (terms & ~fullest.terms) /* not one of its subsets */
			continue;
		std::vector<int> dropped;
		for (int place : estimated(fullest.terms & ~terms))
			if (place >= kTangential[0])
				dropped.push_back(place);
		double cost = cost_without(fullest.lens, uncertainty.covariance, dropped) -
			      price * double(dropped.size());
		if (cost < least) {
			least = cost;
			chosen = terms;
		}
	}
	return chosen;
}

Parameters sigmas_of(const Views &views, const Fit &fit, const Fit &fullest,
		     const Uncertainty &of_fullest)
{
	Covariance own = uncertainty_of(views, fit).covariance;
	Parameters moved = parameters_of(fit.lens) - parameters_of(fullest.lens);
	Parameters sigmas;
	for (int i = 0; i < kParameters; i++)
		sigmas(i) = std::sqrt(
			std::max(of_fullest.covariance(i, i), own(i, i) + moved(i) * moved(i)));
	return sigmas;
}

} // namespace dio
