/* Where the corners and markers of a board lie, in units of one square. */
#ifndef DIO_CALIB_LAYOUT_HPP
#define DIO_CALIB_LAYOUT_HPP

#include <vector>

#include <opencv2/core.hpp>

#include "dio/board.h"

namespace dio
{

/** Inner corners: columns, rows, and the position of the first in squares from the board's corner.
 */
struct CornerGrid {
	int cols, rows;
	double origin_squares;
	int count() const
	{
		return cols * rows;
	}
	cv::Point2d at(int id) const
	{
		return {origin_squares + id % cols, origin_squares + id / cols};
	}
};

CornerGrid corner_grid(const dio_board &board);

/** Size of the board in metres, margin not counted, and its centre in the board frame. */
cv::Point2d board_centre_m(const dio_board &board);

/** One square of a ChArUco board that carries a marker. */
struct MarkerSquare {
	int id, col, row;
};

/** All marker squares in the order of their ids; `layout` is MODERN or LEGACY. */
std::vector<MarkerSquare> marker_squares(const dio_board &board, dio_board_layout layout);

/** True when both layouts are the same board (an odd number of rows). */
bool layouts_agree(const dio_board &board);

} // namespace dio

#endif
