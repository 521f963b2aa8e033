/* Markers through the objdetect module of OpenCV from 4.7 on. */
#include "markers.hpp"

#include <opencv2/objdetect/aruco_detector.hpp>

namespace dio
{

namespace
{

class ObjdetectDetector : public MarkerDetector
{
      public:
	explicit ObjdetectDetector(int dictionary)
	    : dictionary_(cv::aruco::getPredefinedDictionary(dictionary)),
	      detector_(dictionary_, cv::aruco::DetectorParameters())
	{
	}

	std::vector<Marker> detect(const cv::Mat &gray) override
	{
		std::vector<std::vector<cv::Point2f>> corners;
		std::vector<int> ids;
		detector_.detectMarkers(gray, corners, ids);
		std::vector<Marker> markers(ids.size());
		for (size_t i = 0; i < ids.size(); i++) {
			markers[i].id = ids[i];
			std::copy_n(corners[i].begin(), 4, markers[i].corners);
		}
		return markers;
	}

	cv::Mat modules(int id) const override
	{
		cv::Mat picture;
		dictionary_.generateImageMarker(id, dictionary_.markerSize + 2, picture, 1);
		return picture;
	}

      private:
	cv::aruco::Dictionary dictionary_;
	cv::aruco::ArucoDetector detector_;
};

} // namespace

std::unique_ptr<MarkerDetector> MarkerDetector::create(int dictionary)
{
	return std::make_unique<ObjdetectDetector>(dictionary);
}

} // namespace dio
