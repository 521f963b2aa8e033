/* Camera models as files others read: OpenCV YAML and ROS camera_info YAML. */
#include "dio/calibration.h"

#include <algorithm>
#include <array>
#include <locale>
#include <sstream>
#include <string>

#include "dio/atomic_file.h"
#include "guard.hpp"
#include "planar.hpp"

namespace dio
{

namespace
{

constexpr const char *kSigmaNames[9] = {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"};

std::array<double, 9> sigmas_of(const dio_calibration &calibration)
{
	std::array<double, 9> sigmas = {calibration.sigma_fx, calibration.sigma_fy,
					calibration.sigma_cx, calibration.sigma_cy};
	std::copy_n(calibration.sigma_dist, 5, sigmas.begin() + 4);
	return sigmas;
}

/* Enough digits that reading gives the same bits; a point whatever the locale says. */
std::ostringstream number_stream()
{
	std::ostringstream out;
	out.imbue(std::locale::classic());
	out.precision(17);
	return out;
}

std::string list(std::initializer_list<double> values)
{
	std::ostringstream out = number_stream();
	const char *separator = "[";
	for (double value : values) {
		out << separator << value;
		separator = ", ";
	}
	out << "]";
	return out.str();
}

std::string distortion_list(const dio_camera_model &model)
{
	const double *d = model.dist;
	return list({d[0], d[1], d[2], d[3], d[4]});
}

std::string write_opencv(const dio_camera_model &model, const dio_calibration *calibration)
{
	cv::FileStorage file("camera.yaml", cv::FileStorage::WRITE | cv::FileStorage::MEMORY |
						    cv::FileStorage::FORMAT_YAML);
	Lens lens = lens_of(model);
	file << "image_width" << int(model.width) << "image_height" << int(model.height);
	file << "camera_matrix" << cv::Mat(lens.matrix);
	file << "distortion_coefficients" << cv::Mat(lens.distortion).reshape(1, 1);
	if (calibration) {
		std::array<double, 9> sigmas = sigmas_of(*calibration);
		file << "avg_reprojection_error" << calibration->rms_px;
		file << "calibration"
		     << "{";
		file << "heldout_error" << calibration->heldout_rms_px;
		file << "coverage" << calibration->coverage << "tilt_deg" << calibration->tilt_deg;
		file << "views_used" << int(calibration->views_used);
		file << "views_total" << int(calibration->views_total);
		for (size_t i = 0; i < sigmas.size(); i++)
			file << std::string("sigma_") + kSigmaNames[i] << sigmas[i];
		file << "}";
	}
	return file.releaseAndGetString();
}

std::string write_ros(const dio_camera_model &m, const dio_calibration *calibration)
{
	std::ostringstream out = number_stream();
	if (calibration) {
		std::array<double, 9> sigmas = sigmas_of(*calibration);
		out << "# reprojection error " << calibration->rms_px << " px, held out "
		    << calibration->heldout_rms_px << " px, " << calibration->views_used << " of "
		    << calibration->views_total << " views, coverage " << calibration->coverage
		    << ", tilt " << calibration->tilt_deg << " degrees\n# one sigma:";
		for (size_t i = 0; i < sigmas.size(); i++)
			out << " " << kSigmaNames[i] << " " << sigmas[i];
		out << "\n";
	}
	out << "image_width: " << m.width << "\nimage_height: " << m.height
	    << "\ncamera_name: camera\n"
	    << "camera_matrix:\n  rows: 3\n  cols: 3\n  data: "
	    << list({m.fx, 0, m.cx, 0, m.fy, m.cy, 0, 0, 1}) << "\ndistortion_model: plumb_bob\n"
	    << "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: " << distortion_list(m)
	    << "\nrectification_matrix:\n  rows: 3\n  cols: 3\n  data: "
	    << list({1, 0, 0, 0, 1, 0, 0, 0, 1})
	    << "\nprojection_matrix:\n  rows: 3\n  cols: 4\n  data: "
	    << list({m.fx, 0, m.cx, 0, 0, m.fy, m.cy, 0, 0, 0, 1, 0}) << "\n";
	return out.str();
}

} // namespace

} // namespace dio

extern "C" {

enum dio_status dio_camera_model_write(const char *path, enum dio_camera_file kind,
				       const struct dio_camera_model *model,
				       const struct dio_calibration *calibration,
				       struct dio_error *error)
{
	std::string text;
	enum dio_status status = dio::guarded(error, path, [&] {
		dio::check_model(*model, path);
		text = kind == DIO_CAMERA_FILE_ROS ? dio::write_ros(*model, calibration)
						   : dio::write_opencv(*model, calibration);
	});
	return status == DIO_OK ? dio_atomic_file_write(path, text.data(), text.size(), error)
				: status;
}

} // extern "C"
