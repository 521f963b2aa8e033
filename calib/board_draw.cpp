#include "dio/board.h"

#include "detect.hpp"
#include "guard.hpp"
#include "layout.hpp"

namespace dio
{

namespace
{

/* Fill [x0, x1) x [y0, y1) with one grey. */
void fill(cv::Mat &rgb, int x0, int y0, int x1, int y1, int grey)
{
	rgb(cv::Rect(x0, y0, x1 - x0, y1 - y0)).setTo(cv::Scalar::all(grey));
}

/* Each module gets whole pixels, edges rounded alike on every marker. */
void draw_marker(cv::Mat &rgb, const cv::Mat &modules, double left, double top, double side)
{
	auto edge = [&](double start, int i) {
		return int(std::lround(start + side * i / modules.cols));
	};
	for (int row = 0; row < modules.rows; row++)
		for (int col = 0; col < modules.cols; col++)
			fill(rgb, edge(left, col), edge(top, row), edge(left, col + 1),
			     edge(top, row + 1), modules.at<uchar>(row, col));
}

void draw_charuco(const dio_board &board, int square, int margin, cv::Mat &rgb)
{
	for (int row = 0; row < int(board.rows); row++)
		for (int col = 0; col < int(board.cols); col++)
			fill(rgb, margin + col * square, margin + row * square,
			     margin + (col + 1) * square, margin + (row + 1) * square, 0);

	auto markers = MarkerDetector::create(board.dictionary);
	double side = square * board.marker_m / board.square_m;
	for (const MarkerSquare &place : marker_squares(board, board.layout)) {
		int left = margin + place.col * square, top = margin + place.row * square;
		double gap = (square - side) / 2;
		fill(rgb, left, top, left + square, top + square, 255);
		draw_marker(rgb, markers->modules(place.id), left + gap, top + gap, side);
	}
}

void draw_chessboard(const dio_board &board, int square, int margin, cv::Mat &rgb)
{
	for (int row = 0; row <= int(board.rows); row++)
		for (int col = 0; col <= int(board.cols); col++)
			if ((row + col) % 2 == 0)
				fill(rgb, margin + col * square, margin + row * square,
				     margin + (col + 1) * square, margin + (row + 1) * square, 0);
}

} // namespace

} // namespace dio

extern "C" {

enum dio_status dio_board_draw(const struct dio_board *board, uint32_t square_px,
			       uint32_t margin_px, struct dio_picture *picture,
			       struct dio_error *error)
{
	return dio::guarded(error, "board picture", [&] {
		uint32_t extra = board->kind == DIO_BOARD_CHESSBOARD ? 1 : 0;
		uint64_t width = uint64_t(board->cols + extra) * square_px + 2ull * margin_px;
		uint64_t height = uint64_t(board->rows + extra) * square_px + 2ull * margin_px;
		uint32_t least = board->kind == DIO_BOARD_CHARUCO ? 20 : 2;
		if (square_px < least || width > 16384 || height > 16384)
			dio::fail(DIO_BAD_ARG,
				  "board picture: %u pixels a square make %llux%llu pixels; a "
				  "square takes "
				  "at least %u, a side at most 16384",
				  square_px, static_cast<unsigned long long>(width),
				  static_cast<unsigned long long>(height), least);
		dio_picture made = {};
		if (dio_picture_init(&made, uint32_t(width), uint32_t(height)) != DIO_OK)
			throw std::bad_alloc();
		try {
			cv::Mat rgb(int(height), int(width), CV_8UC3, made.rgb);
			rgb.setTo(cv::Scalar::all(255));
			if (board->kind == DIO_BOARD_CHARUCO)
				dio::draw_charuco(*board, int(square_px), int(margin_px), rgb);
			else
				dio::draw_chessboard(*board, int(square_px), int(margin_px), rgb);
		} catch (...) {
			dio_picture_deinit(&made);
			throw;
		}
		dio_picture_deinit(picture);
		*picture = made;
	});
}

} // extern "C"
