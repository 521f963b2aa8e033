#include "dio/pose.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include <opencv2/imgproc.hpp>

#include "guard.hpp"
#include "planar.hpp"

/*
 * A smaller picture is sampled `oversampling` times finer and averaged, since one sample a pixel
 * would alias.
 */
struct dio_undistorter {
	uint32_t in_width = 0, in_height = 0;
	cv::Size out_size;
	int oversampling = 1;
	cv::Mat map_x, map_y; /* [oversampling * out_size] */
};

namespace dio
{

namespace
{

/* Distortion of one ray, with the sign of the map's Jacobian: behind a fold it is not positive. */
struct Distorted {
	cv::Point2d point;
	double jacobian;
};

Distorted distort(const dio_camera_model &model, cv::Point2d ray)
{
	double k1 = model.dist[0], k2 = model.dist[1], p1 = model.dist[2], p2 = model.dist[3],
	       k3 = model.dist[4];
	double x = ray.x, y = ray.y, r2 = x * x + y * y;
	double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
	double slope = k1 + r2 * (2 * k2 + r2 * 3 * k3); /* d radial / d r2 */
	double xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x;
	double yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
	double xy = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
	return {{model.fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + model.cx,
		 model.fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + model.cy},
		radial > 0 ? xx * yy - xy * xy : -1};
}

/* Does a pinhole picture of this focal length see nothing but the distorted picture? */
bool covered(const dio_camera_model &model, cv::Size out, double focal_px)
{
	constexpr int kSteps = 48;
	double cx = (out.width - 1) / 2.0, cy = (out.height - 1) / 2.0;
	for (int j = 0; j <= kSteps; j++)
		for (int i = 0; i <= kSteps; i++) {
			/* From the outer edge of the first pixel to that of the last. */
			cv::Point2d pixel(out.width * double(i) / kSteps - 0.5,
					  out.height * double(j) / kSteps - 0.5);
			Distorted seen = distort(
				model, {(pixel.x - cx) / focal_px, (pixel.y - cy) / focal_px});
			if (!(seen.jacobian > 0) || seen.point.x < -0.5 || seen.point.y < -0.5 ||
			    seen.point.x > model.width - 0.5 || seen.point.y > model.height - 0.5)
				return false;
		}
	return true;
}

/* Fields of view of one shape are nested, so the shortest covered focal length can be bisected. */
double shortest_focal(const dio_camera_model &model, cv::Size out)
{
	double scale = std::max(double(out.width) / model.width, double(out.height) / model.height);
	double longest = 100 * std::max(model.fx, model.fy) * scale, shortest = longest * 1e-4;
	if (!covered(model, out, longest))
		fail(DIO_BAD_ARG,
		     "undistortion: the principal point %.1f, %.1f is not inside the %ux%u picture",
		     model.cx, model.cy, model.width, model.height);
	for (int i = 0; i < 60; i++) {
		double middle = std::sqrt(shortest * longest);
		(covered(model, out, middle) ? longest : shortest) = middle;
	}
	return longest;
}

void make_maps(const dio_camera_model &model, double focal_px, dio_undistorter &made)
{
	int times = made.oversampling;
	cv::Size size(made.out_size.width * times, made.out_size.height * times);
	double cx = (size.width - 1) / 2.0, cy = (size.height - 1) / 2.0;
	made.map_x.create(size, CV_32F);
	made.map_y.create(size, CV_32F);
	for (int row = 0; row < size.height; row++)
		for (int col = 0; col < size.width; col++) {
			Distorted seen = distort(model, {(col - cx) / (focal_px * times),
							 (row - cy) / (focal_px * times)});
			made.map_x.at<float>(row, col) = float(seen.point.x);
			made.map_y.at<float>(row, col) = float(seen.point.y);
		}
}

void apply(const dio_undistorter &undistorter, const dio_picture &in, dio_picture &out)
{
	if (!in.rgb || in.width != undistorter.in_width || in.height != undistorter.in_height)
		fail(DIO_BAD_ARG,
		     "undistortion: a picture of %ux%u, the camera model is for %ux%u: calibrate "
		     "at the "
		     "size of the pictures",
		     in.width, in.height, undistorter.in_width, undistorter.in_height);
	cv::Mat source(int(in.height), int(in.width), CV_8UC3, in.rgb), straight;
	int filter = undistorter.oversampling == 1 ? cv::INTER_CUBIC : cv::INTER_LINEAR;
	cv::remap(source, straight, undistorter.map_x, undistorter.map_y, filter,
		  cv::BORDER_REPLICATE);
	if (undistorter.oversampling > 1)
		cv::resize(straight, straight, undistorter.out_size, 0, 0, cv::INTER_AREA);

	uint32_t width = uint32_t(undistorter.out_size.width);
	uint32_t height = uint32_t(undistorter.out_size.height);
	if (!out.rgb || out.width != width || out.height != height) {
		dio_picture made = {};
		if (dio_picture_init(&made, width, height) != DIO_OK)
			throw std::bad_alloc();
		dio_picture_deinit(&out);
		out = made;
	}
	straight.copyTo(cv::Mat(int(height), int(width), CV_8UC3, out.rgb));
}

} // namespace

} // namespace dio

extern "C" {

enum dio_status dio_undistorter_create(const struct dio_camera_model *model, uint32_t width,
				       uint32_t height, struct dio_camera_model *pinhole,
				       struct dio_undistorter **undistorter,
				       struct dio_error *error)
{
	return dio::guarded(error, "undistortion", [&] {
		dio::check_model(*model, "undistortion");
		if (width == 0 || height == 0 || width > 8192 || height > 8192)
			dio::fail(DIO_BAD_ARG, "undistortion: a picture of %ux%u asked for", width,
				  height);
		auto made = std::make_unique<dio_undistorter>();
		made->in_width = model->width;
		made->in_height = model->height;
		made->out_size = {int(width), int(height)};
		double focal_px = dio::shortest_focal(*model, made->out_size);
		double reduction = std::max(model->fx, model->fy) / focal_px;
		made->oversampling = std::clamp(int(std::ceil(reduction - 0.05)), 1, 32);
		dio::make_maps(*model, focal_px, *made);

		*pinhole = dio_camera_model{};
		pinhole->width = width;
		pinhole->height = height;
		pinhole->fx = pinhole->fy = focal_px;
		pinhole->cx = (width - 1) / 2.0;
		pinhole->cy = (height - 1) / 2.0;
		*undistorter = made.release();
	});
}

enum dio_status dio_undistorter_apply(const struct dio_undistorter *undistorter,
				      const struct dio_picture *in, struct dio_picture *out,
				      struct dio_error *error)
{
	return dio::guarded(error, "undistortion", [&] { dio::apply(*undistorter, *in, *out); });
}

void dio_undistorter_destroy(struct dio_undistorter *undistorter)
{
	delete undistorter;
}

} // extern "C"
