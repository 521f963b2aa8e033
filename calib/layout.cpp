#include "layout.hpp"

namespace dio
{

CornerGrid corner_grid(const dio_board &board)
{
	/* A ChArUco board counts squares and starts at its outer edge; a chessboard counts inner
	 * corners and starts at the first of them, as OpenCV's users are used to. */
	if (board.kind == DIO_BOARD_CHARUCO)
		return {int(board.cols) - 1, int(board.rows) - 1, 1.0};
	return {int(board.cols), int(board.rows), 0.0};
}

cv::Point2d board_centre_m(const dio_board &board)
{
	CornerGrid grid = corner_grid(board);
	cv::Point2d sum = grid.at(0) + grid.at(grid.count() - 1);
	return sum * (board.square_m / 2);
}

bool layouts_agree(const dio_board &board)
{
	return board.kind != DIO_BOARD_CHARUCO || board.rows % 2 == 1;
}

std::vector<MarkerSquare> marker_squares(const dio_board &board, dio_board_layout layout)
{
	int white_at_origin = layout == DIO_LAYOUT_LEGACY && board.rows % 2 == 0;
	std::vector<MarkerSquare> squares;
	for (int row = 0; row < int(board.rows); row++)
		for (int col = 0; col < int(board.cols); col++)
			if ((row + col) % 2 != white_at_origin)
				squares.push_back({int(squares.size()), col, row});
	return squares;
}

} // namespace dio
