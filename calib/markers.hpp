/* Marker detection, the one part where OpenCV's API differs between 4.6 and 4.7. */
#ifndef DIO_CALIB_MARKERS_HPP
#define DIO_CALIB_MARKERS_HPP

#include <memory>
#include <vector>

#include <opencv2/core.hpp>

namespace dio
{

struct Marker {
	int id;
	cv::Point2f corners[4]; /* clockwise from the marker's own top left */
};

/** Markers of one of OpenCV's predefined dictionaries. Implemented once per API, chosen by CMake.
 */
class MarkerDetector
{
      public:
	static std::unique_ptr<MarkerDetector> create(int dictionary);
	virtual ~MarkerDetector() = default;

	virtual std::vector<Marker> detect(const cv::Mat &gray) = 0;

	/** The marker with its black border, one pixel a module, 0 or 255. */
	virtual cv::Mat modules(int id) const = 0;
};

} // namespace dio

#endif
