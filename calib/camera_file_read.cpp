/* Reads OpenCV YAML and ROS camera_info YAML: the same keys, a tag and a header line apart. */
#include "dio/calibration.h"

#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "dio/file.h"
#include "guard.hpp"
#include "planar.hpp"

namespace dio
{

namespace
{

constexpr size_t kMaxBytes = 256 * 1024;

std::string read_text(const char *path)
{
	uint8_t *bytes = nullptr;
	size_t size = 0;
	Failure failure;
	failure.status = dio_file_read(path, kMaxBytes, &bytes, &size, &failure.error);
	if (failure.status != DIO_OK)
		throw failure;
	std::unique_ptr<uint8_t, decltype(&free)> owner(bytes, free);
	return std::string(reinterpret_cast<const char *>(bytes), size);
}

/*
 * OpenCV's parser wants its header line, which ROS files lack, and recurses into brackets, so their
 * depth is limited here.
 */
std::string prepare_text(const char *path, std::string text)
{
	if (text.compare(0, 3, "\xEF\xBB\xBF") == 0)
		text.erase(0, 3);
	int depth = 0;
	for (char c : text) {
		depth += (c == '[' || c == '{') - (c == ']' || c == '}');
		if (depth > 8)
			fail(DIO_BAD_FILE, "%s: brackets nested too deep for a camera model", path);
		if (c == '\0')
			fail(DIO_BAD_FILE, "%s: a binary file, not a camera model in YAML", path);
	}
	size_t start = text.find_first_not_of(" \t\r\n");
	if (start == std::string::npos)
		fail(DIO_BAD_FILE, "%s: empty, not a camera model in YAML", path);
	if (text[start] == '<' || text[start] == '{')
		fail(DIO_BAD_FILE, "%s: neither OpenCV YAML nor ROS camera_info YAML", path);
	if (text.compare(0, 5, "%YAML") == 0)
		return text;
	return (text.compare(start, 3, "---") == 0 ? "%YAML:1.0\n" : "%YAML:1.0\n---\n") +
	       text.substr(start);
}

cv::FileNode require(const char *path, const cv::FileNode &parent, const char *key)
{
	cv::FileNode node = parent[key];
	if (node.empty())
		fail(DIO_BAD_FILE, "%s: key '%s' is missing: write it with 'diorama calibrate'",
		     path, key);
	return node;
}

double number(const char *path, const cv::FileNode &node, const char *key)
{
	if (!node.isInt() && !node.isReal())
		fail(DIO_BAD_FILE, "%s: '%s' is not a number", path, key);
	double value = node.real();
	if (!std::isfinite(value))
		fail(DIO_BAD_FILE, "%s: '%s' is not finite", path, key);
	return value;
}

uint32_t picture_side(const char *path, const cv::FileNode &root, const char *key)
{
	double value = number(path, require(path, root, key), key);
	if (value < 1 || value > 65536 || value != std::floor(value))
		fail(DIO_BAD_FILE, "%s: '%s' %g is no picture size", path, key, value);
	return uint32_t(value);
}

/* rows, cols and data of a matrix, in OpenCV's tagged form and ROS's plain one. */
std::vector<double> matrix(const char *path, const cv::FileNode &root, const char *key)
{
	cv::FileNode node = require(path, root, key);
	if (!node.isMap())
		fail(DIO_BAD_FILE, "%s: '%s' is not a matrix with rows, cols and data", path, key);
	double rows = number(path, require(path, node, "rows"), key);
	double cols = number(path, require(path, node, "cols"), key);
	cv::FileNode data = require(path, node, "data");
	std::vector<double> values;
	if (data.isSeq())
		for (const cv::FileNode &value : data)
			values.push_back(number(path, value, key));
	if (values.empty() || rows * cols != double(values.size()))
		fail(DIO_BAD_FILE, "%s: '%s' states %gx%g numbers and has %zu", path, key, rows,
		     cols, values.size());
	return values;
}

void read_matrix(const char *path, const cv::FileNode &root, dio_camera_model &model)
{
	const char *key = "camera_matrix";
	std::vector<double> k = matrix(path, root, key);
	if (k.size() != 9)
		fail(DIO_BAD_FILE, "%s: '%s' has %zu numbers, 9 expected", path, key, k.size());
	if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1)
		fail(DIO_BAD_FILE, "%s: '%s' is not [fx 0 cx; 0 fy cy; 0 0 1]", path, key);
	if (!(k[0] > 0) || !(k[4] > 0))
		fail(DIO_BAD_FILE, "%s: '%s' has a focal length of %g, %g: it must be positive",
		     path, key, k[0], k[4]);
	model.fx = k[0];
	model.cx = k[2];
	model.fy = k[4];
	model.cy = k[5];
}

void read_distortion(const char *path, const cv::FileNode &root, dio_camera_model &model)
{
	const char *key = "distortion_coefficients";
	cv::FileNode kind = root["distortion_model"];
	if (kind.isString() && kind.string() != "plumb_bob" &&
	    kind.string() != "rational_polynomial")
		fail(DIO_UNSUPPORTED, "%s: 'distortion_model' %s is not plumb_bob", path,
		     kind.string().c_str());
	std::vector<double> d = matrix(path, root, key);
	if (d.size() < 4)
		fail(DIO_BAD_FILE, "%s: '%s' has %zu numbers, 5 expected", path, key, d.size());
	for (size_t i = 0; i < d.size(); i++) {
		if (i < 5)
			model.dist[i] = d[i];
		else if (d[i] != 0)
			fail(DIO_UNSUPPORTED,
			     "%s: '%s' goes beyond k1 k2 p1 p2 k3: calibrate with those five", path,
			     key);
	}
}

dio_camera_model parse(const char *path, const std::string &text)
{
	try {
		cv::FileStorage file(text, cv::FileStorage::READ | cv::FileStorage::MEMORY |
						   cv::FileStorage::FORMAT_YAML);
		cv::FileNode root = file.root();
		if (!file.isOpened() || !root.isMap())
			fail(DIO_BAD_FILE, "%s: neither OpenCV YAML nor ROS camera_info YAML",
			     path);
		dio_camera_model model = {};
		model.width = picture_side(path, root, "image_width");
		model.height = picture_side(path, root, "image_height");
		read_matrix(path, root, model);
		read_distortion(path, root, model);
		return model;
	} catch (const cv::Exception &exception) {
		fail(DIO_BAD_FILE, "%s: not readable as YAML: %s", path, exception.err.c_str());
	}
}

} // namespace

} // namespace dio

extern "C" {

enum dio_status dio_camera_model_read(const char *path, struct dio_camera_model *model,
				      struct dio_error *error)
{
	return dio::guarded(error, path, [&] {
		std::string text = dio::prepare_text(path, dio::read_text(path));
		*model = dio::parse(path, text);
	});
}

} // extern "C"
