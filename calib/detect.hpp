/* Board detection in one grey picture: what the two kinds of board share. */
#ifndef DIO_CALIB_DETECT_HPP
#define DIO_CALIB_DETECT_HPP

#include <vector>

#include <opencv2/core.hpp>

#include "dio/board.h"
#include "markers.hpp"

namespace dio
{

/** Corners of one picture; ids are grid positions row by row, none twice. Empty: no board. */
struct Detection {
	std::vector<int> ids;
	std::vector<cv::Point2f> points;
	dio_board_layout layout = DIO_LAYOUT_MODERN;
	bool layout_is_certain = false; /* the other layout was tried and fits worse */
	bool by_sector_detector = false;
	double sharpness_px = 0;
};

/** `layout` MODERN or LEGACY is taken as given; AUTO tries both. */
Detection detect_charuco(const dio_board &board, dio_board_layout layout, MarkerDetector &markers,
			 const cv::Mat &gray);

Detection detect_chessboard(const dio_board &board, const cv::Mat &gray);

/**
 * Move a corner to the saddle point of the grey values around it.
 *
 * half_window   pixels to each side; the corner stays where it was when the search leaves it
 */
cv::Point2f refine_corner(const cv::Mat &gray, cv::Point2f start, int half_window);

/** Transform a point by a homography. */
cv::Point2d apply_homography(const cv::Matx33d &homography, cv::Point2d point);

} // namespace dio

#endif
