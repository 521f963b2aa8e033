/*
 * Chessboard corners: the classic detector (quads of a thresholded picture) and the sector-based
 * one (Radon transform at saddle points). Each finds boards the other misses. A large picture is
 * searched reduced; the places are measured in the full one, and the grid that runs smoother wins.
 */
#include "detect.hpp"

#include <algorithm>
#include <cmath>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "layout.hpp"

namespace dio
{

namespace
{

using Points = std::vector<cv::Point2f>;

/* Longest side of the picture that is searched first. */
constexpr int kSearchSide = 1024;

/*
 * The sector detector's own places err smoothly, which roughness does not see: they must be this
 * much smoother than the saddle points, as they are in a blurred picture.
 */
constexpr double kUnrefinedHandicap = 2;

double shortest_step(const CornerGrid &grid, const Points &points)
{
	double shortest = 1e9;
	for (int id = 0; id < grid.count(); id++) {
		if (id % grid.cols + 1 < grid.cols)
			shortest = std::min(shortest,
					    cv::norm(points[size_t(id)] - points[size_t(id + 1)]));
		if (id + grid.cols < grid.count())
			shortest = std::min(shortest, cv::norm(points[size_t(id)] -
							       points[size_t(id + grid.cols)]));
	}
	return shortest;
}

/* All products x^i y^j with i + j <= 3, x and y in [-1, 1] over the grid. */
std::vector<double> cubic_terms(const CornerGrid &grid, int id)
{
	double x = 2.0 * (id % grid.cols) / (grid.cols - 1) - 1;
	double y = 2.0 * (id / grid.cols) / (grid.rows - 1) - 1;
	return {1, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y};
}

/*
 * Roughness of a grid in pixels: what a homography and, over it, a cubic polynomial leave. The
 * homography takes the perspective, the cubic the lens; the rest is error of measurement.
 */
double roughness(const CornerGrid &grid, const Points &points)
{
	std::vector<cv::Point2d> ideal, image;
	for (int id = 0; id < grid.count(); id++) {
		ideal.push_back(grid.at(id));
		image.push_back(points[size_t(id)]);
	}
	cv::Mat found = cv::findHomography(ideal, image);
	if (found.empty())
		return 1e9;
	cv::Matx33d homography(found);
	cv::Mat rest(grid.count(), 2, CV_64F), terms(grid.count(), 10, CV_64F);
	for (int id = 0; id < grid.count(); id++) {
		cv::Point2d miss =
			image[size_t(id)] - apply_homography(homography, ideal[size_t(id)]);
		rest.at<double>(id, 0) = miss.x;
		rest.at<double>(id, 1) = miss.y;
		std::vector<double> row = cubic_terms(grid, id);
		std::copy(row.begin(), row.end(), terms.ptr<double>(id));
	}
	if (std::min(grid.cols, grid.rows) >= 4) { /* else too few corners for a cubic */
		cv::Mat coefficients;
		cv::solve(terms, rest, coefficients, cv::DECOMP_QR);
		rest -= terms * coefficients;
	}
	return cv::norm(rest) / std::sqrt(double(grid.count()));
}

Points refine_all(const cv::Mat &gray, const CornerGrid &grid, const Points &points)
{
	int window = std::clamp(int(shortest_step(grid, points) / 4), 3, 20);
	Points refined;
	for (cv::Point2f point : points)
		refined.push_back(refine_corner(gray, point, window));
	return refined;
}

double mean_of_cell(const cv::Mat &gray, const CornerGrid &grid, const Points &points, int col,
		    int row)
{
	size_t first = size_t(row * grid.cols + col);
	size_t below = first + size_t(grid.cols);
	cv::Point2f centre =
		(points[first] + points[first + 1] + points[below] + points[below + 1]) / 4;
	cv::Rect around(int(centre.x) - 1, int(centre.y) - 1, 3, 3);
	around &= cv::Rect(0, 0, gray.cols, gray.rows);
	return around.empty() ? 127 : cv::mean(gray(around))[0];
}

/* Mean grey of the cells with the first cell's colour, less that of the others. */
double first_cell_contrast(const cv::Mat &gray, const CornerGrid &grid, const Points &points)
{
	double sum[2] = {0, 0};
	int count[2] = {0, 0};
	for (int row = 0; row + 1 < grid.rows; row++)
		for (int col = 0; col + 1 < grid.cols; col++) {
			sum[(row + col) % 2] += mean_of_cell(gray, grid, points, col, row);
			count[(row + col) % 2]++;
		}
	return sum[0] / count[0] - sum[1] / count[1];
}

/*
 * Number the corners as the board does: z into the board, so columns turn into rows clockwise in a
 * picture; the first cell dark where half a turn changes its colour (columns + rows odd). Where it
 * does not, the board looks the same upside down; the way that is more upright in the picture is
 * taken.
 */
void normalise_order(const cv::Mat &gray, const CornerGrid &grid, Points &points)
{
	size_t last_col = size_t(grid.cols - 1), last = points.size() - 1;
	cv::Point2f along = points[last_col] - points[0];
	cv::Point2f down = points[last - last_col] - points[0];
	if (along.cross(down) < 0)
		for (int row = 0; row < grid.rows; row++)
			std::reverse(points.begin() + row * grid.cols,
				     points.begin() + (row + 1) * grid.cols);

	bool turn;
	if ((grid.cols + grid.rows) % 2 == 1) {
		turn = first_cell_contrast(gray, grid, points) > 0;
	} else {
		cv::Point2f diagonal = points[last] - points[0];
		turn = diagonal.x + diagonal.y < 0;
	}
	if (turn)
		std::reverse(points.begin(), points.end());
}

bool plausible(const cv::Mat &gray, const CornerGrid &grid, const Points &points)
{
	if (int(points.size()) != grid.count())
		return false;
	cv::Rect2f inside(0, 0, float(gray.cols - 1), float(gray.rows - 1));
	for (cv::Point2f point : points)
		if (!std::isfinite(point.x) || !std::isfinite(point.y) || !inside.contains(point))
			return false;
	return shortest_step(grid, points) >= 4;
}

Points to_full_size(Points points, const cv::Mat &searched, const cv::Mat &gray)
{
	float scale_x = float(gray.cols) / float(searched.cols);
	float scale_y = float(gray.rows) / float(searched.rows);
	for (cv::Point2f &point : points)
		point = {(point.x + 0.5f) * scale_x - 0.5f, (point.y + 0.5f) * scale_y - 0.5f};
	return points;
}

/* The best measured grid so far. */
struct Best {
	Points points;
	double roughness_px = 1e9;
	bool by_sector_detector = false;
	void offer(const CornerGrid &grid, const Points &candidate, bool by_sector,
		   double handicap = 1)
	{
		double rough = handicap * roughness(grid, candidate);
		if (rough >= roughness_px)
			return;
		points = candidate;
		roughness_px = rough;
		by_sector_detector = by_sector;
	}
};

void search_classic(const cv::Mat &gray, const cv::Mat &searched, const CornerGrid &grid,
		    Best &best)
{
	Points points;
	if (!cv::findChessboardCorners(searched, {grid.cols, grid.rows}, points,
				       cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE))
		return;
	points = to_full_size(points, searched, gray);
	if (plausible(gray, grid, points))
		best.offer(grid, refine_all(gray, grid, points), false);
}

void search_sectors(const cv::Mat &gray, const cv::Mat &searched, const CornerGrid &grid,
		    int effort, Best &best)
{
	Points points;
	if (!cv::findChessboardCornersSB(searched, {grid.cols, grid.rows}, points,
					 cv::CALIB_CB_NORMALIZE_IMAGE | effort))
		return;
	points = to_full_size(points, searched, gray);
	if (!plausible(gray, grid, points))
		return;
	best.offer(grid, refine_all(gray, grid, points), true);
	best.offer(grid, points, true, kUnrefinedHandicap);
}

/* A reduced picture first; where both fail, the sector detector on all there is. */
Best search(const cv::Mat &gray, const CornerGrid &grid)
{
	Best best;
	cv::Mat reduced = gray;
	double scale = double(kSearchSide) / std::max(gray.cols, gray.rows);
	if (scale < 1)
		cv::resize(gray, reduced, cv::Size(), scale, scale, cv::INTER_AREA);
	search_classic(gray, reduced, grid, best);
	search_sectors(gray, reduced, grid, cv::CALIB_CB_EXHAUSTIVE, best);
	if (best.points.empty()) {
		/* ACCURACY doubles the picture, at four times the cost. */
		int effort = cv::CALIB_CB_EXHAUSTIVE | (scale < 1 ? 0 : cv::CALIB_CB_ACCURACY);
		search_sectors(gray, gray, grid, effort, best);
	}
	return best;
}

/* Width of the black-white edges; 0 when the detector cannot say. */
double measure_sharpness(const cv::Mat &gray, const CornerGrid &grid, const Points &points)
{
	try {
		return cv::estimateChessboardSharpness(gray, {grid.cols, grid.rows}, points)[0];
	} catch (const cv::Exception &) {
		return 0;
	}
}

} // namespace

Detection detect_chessboard(const dio_board &board, const cv::Mat &gray)
{
	CornerGrid grid = corner_grid(board);
	Best best = search(gray, grid);
	Detection detection;
	if (best.points.empty())
		return detection;
	normalise_order(gray, grid, best.points);
	detection.points = best.points;
	detection.by_sector_detector = best.by_sector_detector;
	detection.sharpness_px = measure_sharpness(gray, grid, best.points);
	for (int id = 0; id < grid.count(); id++)
		detection.ids.push_back(id);
	return detection;
}

} // namespace dio
