#include "dio/board.h"

#include <cmath>
#include <cstdlib>

#include <opencv2/imgproc.hpp>

#include "detect.hpp"
#include "guard.hpp"
#include "layout.hpp"

struct dio_board_detector {
	dio_board board = {};
	std::unique_ptr<dio::MarkerDetector> markers;
};

namespace dio
{

cv::Point2d apply_homography(const cv::Matx33d &homography, cv::Point2d point)
{
	cv::Vec3d mapped = homography * cv::Vec3d(point.x, point.y, 1);
	return {mapped[0] / mapped[2], mapped[1] / mapped[2]};
}

cv::Point2f refine_corner(const cv::Mat &gray, cv::Point2f start, int half_window)
{
	std::vector<cv::Point2f> point = {start};
	cv::cornerSubPix(gray, point, {half_window, half_window}, {-1, -1},
			 {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-4});
	return point[0];
}

namespace
{

/* Blocks of C memory, since C callers release them. */
void export_corners(const Detection &detection, const dio_board &board, dio_corners *corners)
{
	size_t count = detection.ids.size();
	dio_corners result = {};
	result.count = uint32_t(count);
	result.sharpness_px = detection.sharpness_px;
	result.layout = detection.layout;
	result.by_sector_detector = detection.by_sector_detector;
	if (count > 0) {
		result.ids = static_cast<uint32_t *>(calloc(count, sizeof(*result.ids)));
		result.image_px = static_cast<float(*)[2]>(calloc(count, sizeof(*result.image_px)));
		result.board_m = static_cast<double(*)[3]>(calloc(count, sizeof(*result.board_m)));
		if (!result.ids || !result.image_px || !result.board_m) {
			dio_corners_deinit(&result);
			throw std::bad_alloc();
		}
	}
	CornerGrid grid = corner_grid(board);
	for (size_t i = 0; i < count; i++) {
		cv::Point2d place = grid.at(detection.ids[i]) * board.square_m;
		result.ids[i] = uint32_t(detection.ids[i]);
		result.image_px[i][0] = detection.points[i].x;
		result.image_px[i][1] = detection.points[i].y;
		result.board_m[i][0] = place.x;
		result.board_m[i][1] = place.y;
	}
	dio_corners_deinit(corners);
	*corners = result;
}

} // namespace

} // namespace dio

extern "C" {

enum dio_status dio_board_detector_create(const struct dio_board *board,
					  struct dio_board_detector **detector,
					  struct dio_error *error)
{
	return dio::guarded(error, "board detector", [&] {
		auto made = std::make_unique<dio_board_detector>();
		made->board = *board;
		if (board->kind == DIO_BOARD_CHARUCO)
			made->markers = dio::MarkerDetector::create(board->dictionary);
		if (dio::layouts_agree(*board))
			made->board.layout = DIO_LAYOUT_MODERN;
		*detector = made.release();
	});
}

void dio_board_detector_destroy(struct dio_board_detector *detector)
{
	delete detector;
}

const struct dio_board *dio_board_detector_get_board(const struct dio_board_detector *detector)
{
	return &detector->board;
}

enum dio_status dio_board_detect(struct dio_board_detector *detector,
				 const struct dio_picture *picture, struct dio_corners *corners,
				 struct dio_error *error)
{
	return dio::guarded(error, "board detection", [&] {
		if (!picture->rgb || picture->width < 16 || picture->height < 16)
			dio::fail(DIO_BAD_ARG, "board detection: a picture of %ux%u is too small",
				  picture->width, picture->height);
		cv::Mat rgb(int(picture->height), int(picture->width), CV_8UC3, picture->rgb);
		cv::Mat gray;
		cv::cvtColor(rgb, gray, cv::COLOR_RGB2GRAY);
		dio_board &board = detector->board;
		dio::Detection detection;
		if (board.kind == DIO_BOARD_CHARUCO) {
			detection =
				dio::detect_charuco(board, board.layout, *detector->markers, gray);
			if (detection.layout_is_certain)
				board.layout = detection.layout;
		} else {
			detection = dio::detect_chessboard(board, gray);
		}
		dio::export_corners(detection, board, corners);
	});
}

void dio_corners_deinit(struct dio_corners *corners)
{
	if (!corners)
		return;
	free(corners->ids);
	free(corners->image_px);
	free(corners->board_m);
	*corners = dio_corners{};
}

} // extern "C"
