/* Markers through the contrib aruco module of OpenCV up to 4.6. */
#include "markers.hpp"

#include <opencv2/aruco.hpp>

namespace dio
{

namespace
{

class ContribDetector : public MarkerDetector
{
      public:
	explicit ContribDetector(int dictionary)
	    : dictionary_(cv::aruco::getPredefinedDictionary(dictionary)),
	      parameters_(cv::aruco::DetectorParameters::create())
	{
	}

	std::vector<Marker> detect(const cv::Mat &gray) override
	{
		std::vector<std::vector<cv::Point2f>> corners;
		std::vector<int> ids;
		cv::aruco::detectMarkers(gray, dictionary_, corners, ids, parameters_);
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
		dictionary_->drawMarker(id, dictionary_->markerSize + 2, picture, 1);
		return picture;
	}

      private:
	cv::Ptr<cv::aruco::Dictionary> dictionary_;
	cv::Ptr<cv::aruco::DetectorParameters> parameters_;
};

} // namespace

std::unique_ptr<MarkerDetector> MarkerDetector::create(int dictionary)
{
	return std::make_unique<ContribDetector>(dictionary);
}

} // namespace dio
