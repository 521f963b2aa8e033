#include "calibrate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <unordered_map>

#include <opencv2/calib3d.hpp>

namespace dio
{

namespace
{

double median_of(std::vector<double> values)
{
	auto middle = values.begin() + long(values.size() / 2);
	std::nth_element(values.begin(), middle, values.end());
	return *middle;
}

/*
 * What a view may show: the median plus 3.5 robust standard deviations (1.4826 MAD), never less
 * than twice the median, nor than 0.3 px, which is as well as corners are measured.
 */
double robust_threshold(const std::vector<double> &rms)
{
	double median = median_of(rms);
	std::vector<double> away;
	for (double value : rms)
		away.push_back(std::abs(value - median));
	return std::max({median + 3.5 * 1.4826 * median_of(away), 2 * median, 0.3});
}

Views pick(const Views &views, const std::vector<bool> &used)
{
	Views picked;
	for (size_t i = 0; i < views.size(); i++)
		if (used[i])
			picked.push_back(views[i]);
	return picked;
}

/* RMS of every view with the best pose under one lens. */
std::vector<double> pose_rms(const Views &views, const Lens &lens)
{
	std::vector<double> rms;
	for (const View &view : views) {
		std::vector<PlanarPose> poses = solve_planar(view, lens);
		rms.push_back(poses.empty() ? std::numeric_limits<double>::infinity()
					    : poses[0].rms_px);
	}
	return rms;
}

/* Fit and reject from the views marked in `used` on, until the set stands still. */
Consensus settle(const Views &views, cv::Size size, size_t min_views, std::vector<bool> used)
{
	constexpr int kMaxRounds = 8;
	Consensus consensus;
	for (int round = 0;; round++) {
		consensus.used = used;
		consensus.fit = fit_views(pick(views, used), size, TERMS_NONE, nullptr);
		consensus.rms_px = pose_rms(views, consensus.fit.lens);
		std::vector<double> among;
		for (size_t i = 0; i < views.size(); i++)
			if (used[i])
				among.push_back(consensus.rms_px[i]);
		consensus.threshold_px = robust_threshold(among);
		size_t left = 0;
		for (size_t i = 0; i < views.size(); i++) {
			used[i] = consensus.rms_px[i] <= consensus.threshold_px;
			left += used[i];
		}
		if (used == consensus.used || left < min_views || round == kMaxRounds)
			return consensus;
	}
}

} // namespace

Consensus find_consensus(const Views &views, cv::Size size, size_t min_views)
{
	std::vector<bool> everything(views.size(), true);
	Consensus whole = settle(views, size, min_views, everything);

	/* Many bad views drag the fit and the median with them. If the better half alone fits more
	 * than twice as well, go by that half. */
	size_t half = std::max(min_views, views.size() / 2);
	if (half >= views.size())
		return whole;
	std::vector<double> sorted = whole.rms_px;
	std::sort(sorted.begin(), sorted.end());
	std::vector<bool> better;
	for (double rms : whole.rms_px)
		better.push_back(rms <= sorted[half - 1]);
	Consensus trimmed = settle(views, size, min_views, better);
	return trimmed.fit.rms_px < whole.fit.rms_px / 2 ? trimmed : whole;
}

int find_duplicate(const Views &views, const View &view, cv::Size size)
{
	/* Half a percent of the picture's diagonal: a camera on a table, not a new viewpoint. */
	double still_px = 0.005 * std::hypot(size.width, size.height);
	std::unordered_map<uint32_t, cv::Point2f> places;
	for (size_t i = 0; i < view.ids.size(); i++)
		places[view.ids[i]] = view.image[i];
	for (const View &other : views) {
		double sum = 0;
		size_t common = 0;
		for (size_t i = 0; i < other.ids.size(); i++) {
			auto place = places.find(other.ids[i]);
			if (place == places.end())
				continue;
			cv::Point2d moved = place->second - other.image[i];
			sum += moved.dot(moved);
			common++;
		}
		bool same_part = 5 * common >= 4 * std::max(view.board.size(), other.board.size());
		if (same_part && std::sqrt(sum / double(common)) < still_px)
			return int(other.index);
	}
	return -1;
}

double coverage_of(const Views &views, cv::Size size)
{
	int across = size.width >= size.height ? 10 : 8;
	int down = 18 - across;
	std::set<int> cells;
	for (const View &view : views)
		for (cv::Point2f point : view.image) {
			int col = std::clamp(int(point.x / float(size.width) * float(across)), 0,
					     across - 1);
			int row = std::clamp(int(point.y / float(size.height) * float(down)), 0,
					     down - 1);
			cells.insert(row * across + col);
		}
	return double(cells.size()) / (across * down);
}

double tilt_of(const Fit &fit)
{
	std::vector<cv::Vec3d> normals;
	for (const PlanarPose &pose : fit.poses) {
		cv::Matx33d rotation;
		cv::Rodrigues(pose.rotation, rotation);
		normals.emplace_back(rotation(0, 2), rotation(1, 2), rotation(2, 2));
	}
	double least = 1;
	for (size_t i = 0; i < normals.size(); i++)
		for (size_t j = 0; j < i; j++)
			least = std::min(least, normals[i].dot(normals[j]));
	return std::acos(std::clamp(least, -1.0, 1.0)) * 180 / CV_PI;
}

} // namespace dio
