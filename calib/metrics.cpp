#include "dio/pose.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <opencv2/imgproc.hpp>

#include "guard.hpp"

namespace dio
{

namespace
{

cv::Mat view_rgb(const dio_picture &picture)
{
	return {int(picture.height), int(picture.width), CV_8UC3, picture.rgb};
}

void require_same_size(const dio_picture *a, const dio_picture *b)
{
	if (!a || !b || !a->rgb || !b->rgb || a->width != b->width || a->height != b->height)
		fail(DIO_BAD_ARG, "metrics: the two pictures differ in size");
}

cv::Mat blur(const cv::Mat &image)
{
	cv::Mat blurred;
	cv::GaussianBlur(image, blurred, {11, 11}, 1.5);
	return blurred;
}

cv::Mat luma(const dio_picture &picture)
{
	cv::Mat scaled, gray;
	view_rgb(picture).convertTo(scaled, CV_32F, 1.0 / 255);
	cv::cvtColor(scaled, gray, cv::COLOR_RGB2GRAY);
	return gray;
}

double psnr(const dio_picture &a, const dio_picture &b)
{
	size_t count = size_t(a.width) * a.height * 3;
	uint64_t sum = 0;
	for (size_t i = 0; i < count; i++) {
		int difference = int(a.rgb[i]) - int(b.rgb[i]);
		sum += uint64_t(difference * difference);
	}
	double mean = double(sum) / (255.0 * 255.0 * double(count));
	return -10 * std::log10(std::max(1e-12, mean));
}

double ssim(const dio_picture &a, const dio_picture &b)
{
	constexpr double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
	cv::Mat ga = luma(a), gb = luma(b);
	cv::Mat ma = blur(ga), mb = blur(gb);
	cv::Mat va = blur(ga.mul(ga)) - ma.mul(ma);
	cv::Mat vb = blur(gb.mul(gb)) - mb.mul(mb);
	cv::Mat vab = blur(ga.mul(gb)) - ma.mul(mb);
	cv::Mat top = (2 * ma.mul(mb) + c1).mul(2 * vab + c2);
	cv::Mat bottom = (ma.mul(ma) + mb.mul(mb) + c1).mul(va + vb + c2);
	return cv::mean(top / bottom)[0];
}

} // namespace

} // namespace dio

extern "C" {

double dio_metrics_psnr(const struct dio_picture *a, const struct dio_picture *b)
{
	double value = std::numeric_limits<double>::quiet_NaN();
	dio::guarded(nullptr, "PSNR", [&] {
		dio::require_same_size(a, b);
		value = dio::psnr(*a, *b);
	});
	return value;
}

double dio_metrics_ssim(const struct dio_picture *a, const struct dio_picture *b)
{
	double value = std::numeric_limits<double>::quiet_NaN();
	dio::guarded(nullptr, "SSIM", [&] {
		dio::require_same_size(a, b);
		value = dio::ssim(*a, *b);
	});
	return value;
}

} // extern "C"
