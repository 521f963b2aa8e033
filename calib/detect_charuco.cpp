/*
 * ChArUco corners from detected markers. The markers say which corner is where; a homography fitted
 * to the markers around a corner says where to look; the saddle point of the picture says where it
 * is. This is done here rather than by OpenCV's own interpolation because that knows one layout
 * up to 4.6 and another API from 4.7 on, and both layouts must work with every version.
 */
#include "detect.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include <opencv2/calib3d.hpp>

#include "layout.hpp"

namespace dio
{

namespace
{

/* A marker placed on the board by one layout. */
struct PlacedMarker {
	cv::Point2d board[4]; /* squares */
	cv::Point2f image[4];
	int col, row;
};

/* How well the markers of a picture agree with one layout. */
struct LayoutFit {
	dio_board_layout layout = DIO_LAYOUT_MODERN;
	std::vector<PlacedMarker> markers; /* inliers */
	cv::Matx33d homography;            /* squares to pixels */
	double rms_squares = 0;
};

constexpr int kMinMarkers = 3;

/* A marker further than this from where the homography puts it is not on the board. */
constexpr double kMaxMarkerErrorSquares = 0.35;

std::vector<PlacedMarker> place_markers(const dio_board &board, dio_board_layout layout,
					const std::vector<Marker> &markers)
{
	std::vector<MarkerSquare> squares = marker_squares(board, layout);
	double side = board.marker_m / board.square_m;
	double gap = (1 - side) / 2;
	std::vector<PlacedMarker> placed;
	for (const Marker &marker : markers) {
		if (marker.id < 0 || marker.id >= int(squares.size()))
			continue;
		const MarkerSquare &square = squares[size_t(marker.id)];
		PlacedMarker item = {};
		item.col = square.col;
		item.row = square.row;
		cv::Point2d corner(square.col + gap, square.row + gap);
		item.board[0] = corner;
		item.board[1] = corner + cv::Point2d(side, 0);
		item.board[2] = corner + cv::Point2d(side, side);
		item.board[3] = corner + cv::Point2d(0, side);
		std::copy_n(marker.corners, 4, item.image);
		placed.push_back(item);
	}
	return placed;
}

std::optional<cv::Matx33d> fit_homography(const std::vector<PlacedMarker> &markers, int method,
					  double threshold_px)
{
	std::vector<cv::Point2d> from, to;
	for (const PlacedMarker &marker : markers)
		for (int i = 0; i < 4; i++) {
			from.push_back(marker.board[i]);
			to.push_back(marker.image[i]);
		}
	cv::Mat found = cv::findHomography(from, to, method, threshold_px);
	if (found.empty() || !cv::checkRange(found))
		return std::nullopt;
	return cv::Matx33d(found);
}

double marker_error_px(const PlacedMarker &marker, const cv::Matx33d &homography)
{
	double worst = 0;
	for (int i = 0; i < 4; i++)
		worst = std::max(worst, cv::norm(apply_homography(homography, marker.board[i]) -
						 cv::Point2d(marker.image[i])));
	return worst;
}

double side_px(const PlacedMarker &marker)
{
	double sum = 0;
	for (int i = 0; i < 4; i++)
		sum += cv::norm(marker.image[i] - marker.image[(i + 1) % 4]);
	return sum / 4;
}

LayoutFit fit_layout(const dio_board &board, dio_board_layout layout,
		     const std::vector<Marker> &detected)
{
	LayoutFit fit;
	fit.layout = layout;
	std::vector<PlacedMarker> placed = place_markers(board, layout, detected);
	if (int(placed.size()) < kMinMarkers)
		return fit;
	double mean_side = 0;
	for (const PlacedMarker &marker : placed)
		mean_side += side_px(marker) / double(placed.size());
	double square = board.square_m / board.marker_m;
	auto rough =
		fit_homography(placed, cv::RANSAC, kMaxMarkerErrorSquares * square * mean_side);
	if (!rough)
		return fit;

	double sum = 0;
	for (const PlacedMarker &marker : placed) {
		double error = marker_error_px(marker, *rough) / (square * side_px(marker));
		if (error > kMaxMarkerErrorSquares)
			continue;
		sum += error * error;
		fit.markers.push_back(marker);
	}
	if (int(fit.markers.size()) < kMinMarkers)
		return fit;
	auto fine = fit_homography(fit.markers, 0, 0);
	fit.homography = fine ? *fine : *rough;
	fit.rms_squares = std::sqrt(sum / double(fit.markers.size()));
	return fit;
}

bool usable(const LayoutFit &fit)
{
	return int(fit.markers.size()) >= kMinMarkers;
}

/* More markers in place wins; with as many, a residual of half the other's. */
bool clearly_better(const LayoutFit &a, const LayoutFit &b)
{
	if (!usable(a))
		return false;
	if (a.markers.size() != b.markers.size())
		return a.markers.size() > b.markers.size();
	return a.rms_squares < b.rms_squares / 2;
}

/* The markers that touch a grid corner, and the pixel position their neighbourhood predicts. */
class CornerPredictor
{
      public:
	explicit CornerPredictor(const LayoutFit &fit) : fit_(fit)
	{
	}

	/* Nothing unless both markers of the two white squares at the corner were seen. */
	std::optional<cv::Point2d> predict(cv::Point2d corner) const
	{
		std::vector<PlacedMarker> near;
		int touching = 0;
		for (const PlacedMarker &marker : fit_.markers) {
			cv::Point2d centre(marker.col + 0.5, marker.row + 0.5);
			double distance = std::max(std::abs(centre.x - corner.x),
						   std::abs(centre.y - corner.y));
			touching += distance < 1;
			if (distance < 2)
				near.push_back(marker);
		}
		if (touching < 2)
			return std::nullopt;
		/* Two markers on a diagonal leave a homography weak across it: lean on the
		 * whole board's then, shifted to where these markers are. */
		if (near.size() >= 4)
			if (auto local = fit_homography(near, 0, 0))
				return apply_homography(*local, corner);
		cv::Point2d shift(0, 0);
		for (const PlacedMarker &marker : near)
			for (int i = 0; i < 4; i++)
				shift += cv::Point2d(marker.image[i]) -
					 apply_homography(fit_.homography, marker.board[i]);
		return apply_homography(fit_.homography, corner) + shift / double(4 * near.size());
	}

      private:
	const LayoutFit &fit_;
};

/* The window must not reach the markers, whose corners would pull the saddle point. */
int corner_window(const dio_board &board, const cv::Matx33d &homography, cv::Point2d corner)
{
	cv::Point2d centre = apply_homography(homography, corner);
	double square = 1e9;
	for (cv::Point2d step : {cv::Point2d(1, 0), cv::Point2d(0, 1)})
		square = std::min(square,
				  cv::norm(apply_homography(homography, corner + step) - centre));
	double gap = (1 - board.marker_m / board.square_m) / 2;
	return std::clamp(int(std::min(gap, 0.2) * square), 2, 15);
}

} // namespace

Detection detect_charuco(const dio_board &board, dio_board_layout layout, MarkerDetector &markers,
			 const cv::Mat &gray)
{
	Detection detection;
	std::vector<Marker> found = markers.detect(gray);
	LayoutFit fit = fit_layout(
		board, layout == DIO_LAYOUT_LEGACY ? DIO_LAYOUT_LEGACY : DIO_LAYOUT_MODERN, found);
	if (layout == DIO_LAYOUT_AUTO && !layouts_agree(board)) {
		LayoutFit legacy = fit_layout(board, DIO_LAYOUT_LEGACY, found);
		detection.layout_is_certain =
			clearly_better(fit, legacy) || clearly_better(legacy, fit);
		if (clearly_better(legacy, fit))
			fit = legacy;
		/* A guess between two layouts would number the corners wrongly. */
		if (!detection.layout_is_certain)
			return detection;
	}
	detection.layout = fit.layout;
	if (!usable(fit))
		return detection;

	CornerGrid grid = corner_grid(board);
	CornerPredictor predictor(fit);
	cv::Rect2d inside(1, 1, gray.cols - 2, gray.rows - 2);
	for (int id = 0; id < grid.count(); id++) {
		auto start = predictor.predict(grid.at(id));
		if (!start || !inside.contains(*start))
			continue;
		int window = corner_window(board, fit.homography, grid.at(id));
		cv::Point2f point = refine_corner(gray, *start, window);
		if (cv::norm(cv::Point2d(point) - *start) > window + 1)
			continue;
		detection.ids.push_back(id);
		detection.points.push_back(point);
	}
	return detection;
}

} // namespace dio
