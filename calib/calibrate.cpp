#include "dio/calibration.h"

#include <cmath>
#include <cstdlib>
#include <limits>

#include "calibrate.hpp"
#include "guard.hpp"

namespace dio
{

namespace
{

/* Fewer corners than this do not tie a view to the lens. */
constexpr uint32_t kMinCorners = 8;

/* Half the views must still make a fit for the held-out figure. */
constexpr uint32_t kLeastViews = 4;

/* Above this share of the picture's diagonal the corners do not belong to one camera and board. */
constexpr double kMaxRmsShare = 0.002;

/* A focal length known worse than this is not known; boards of taped paper reach 3 percent. */
constexpr double kMaxFocalSigmaShare = 0.05;

/* More than this share of contradicting views: which side is right cannot be told. */
constexpr double kMaxOutlierShare = 1.0 / 3;

__attribute__((format(printf, 3, 4))) void leave_out(dio_calibration_view &view, dio_view_use use,
						     const char *format, ...)
{
	view.use = use;
	va_list args;
	va_start(args, format);
	vsnprintf(view.reason, sizeof(view.reason), format, args);
	va_end(args);
}

dio_board_layout majority_layout(const dio_corners *corners, uint32_t count)
{
	uint32_t legacy = 0, modern = 0;
	for (uint32_t i = 0; i < count; i++)
		if (corners[i].count > 0)
			(corners[i].layout == DIO_LAYOUT_LEGACY ? legacy : modern)++;
	return legacy > modern ? DIO_LAYOUT_LEGACY : DIO_LAYOUT_MODERN;
}

/* One calibration from start to end; calibration_ is the caller's and filled as far as it goes. */
class Calibrator
{
      public:
	Calibrator(const dio_corners *corners, uint32_t count, cv::Size size,
		   const dio_calibration_options &options, dio_calibration &calibration)
	    : corners_(corners), count_(count), size_(size), options_(options),
	      calibration_(calibration), min_views_(std::max(options.min_views, kLeastViews))
	{
	}

	void run()
	{
		prepare();
		select_views();
		require_views(views_.size());
		try {
			ask_whether_to_go_on();
			reject_outliers();
			fit_final();
		} catch (const cv::Exception &exception) {
			fail(DIO_REFUSED,
			     "calibration: %zu views determine no camera (%s): tilt the board "
			     "between views",
			     views_.size(), exception.err.c_str());
		}
		ask_whether_to_go_on();
		judge();
	}

      private:
	void ask_whether_to_go_on() const
	{
		if (options_.keep_going && !options_.keep_going(options_.context))
			fail(DIO_REFUSED, "calibration: cancelled");
	}

	void prepare()
	{
		auto *views = static_cast<dio_calibration_view *>(
			calloc(std::max(count_, 1u), sizeof(dio_calibration_view)));
		if (!views)
			throw std::bad_alloc();
		free(calibration_.views);
		calibration_ = dio_calibration{};
		calibration_.views = views;
		calibration_.views_total = count_;
		calibration_.layout = majority_layout(corners_, count_);
	}

	void select_views()
	{
		for (uint32_t i = 0; i < count_; i++) {
			dio_calibration_view &state = calibration_.views[i];
			state.corners = corners_[i].count;
			if (corners_[i].count == 0) {
				leave_out(state, DIO_VIEW_NO_BOARD, "no board found");
				continue;
			}
			View view = view_of(corners_[i]);
			view.index = i;
			int twin = find_duplicate(views_, view, size_);
			if (corners_[i].layout != calibration_.layout)
				leave_out(state, DIO_VIEW_NO_BOARD,
					  "reads as the other ChArUco layout than most pictures");
			else if (corners_[i].count < kMinCorners || !spans_plane(view))
				leave_out(state, DIO_VIEW_NO_BOARD,
					  "%u corners%s, %u over several rows needed",
					  corners_[i].count, spans_plane(view) ? "" : " on a line",
					  kMinCorners);
			else if (twin >= 0)
				leave_out(state, DIO_VIEW_DUPLICATE,
					  "same viewpoint as picture %d: move the board or the "
					  "camera",
					  twin + 1);
			else
				views_.push_back(view);
		}
	}

	void require_views(size_t usable)
	{
		calibration_.views_used = uint32_t(usable);
		if (usable >= min_views_)
			return;
		uint32_t duplicates = 0;
		for (uint32_t i = 0; i < count_; i++)
			duplicates += calibration_.views[i].use == DIO_VIEW_DUPLICATE;
		fail(DIO_REFUSED,
		     "calibration: %zu usable views of %u pictures (%u repeat a viewpoint), at "
		     "least %u "
		     "needed: take more pictures of the board from different sides",
		     usable, count_, duplicates, min_views_);
	}

	void reject_outliers()
	{
		Consensus consensus = find_consensus(views_, size_, min_views_);
		Views kept;
		for (size_t i = 0; i < views_.size(); i++) {
			dio_calibration_view &state = calibration_.views[views_[i].index];
			state.rms_px = consensus.rms_px[i];
			if (consensus.used[i])
				kept.push_back(views_[i]);
			else
				leave_out(
					state, DIO_VIEW_OUTLIER,
					"reprojection error %.2f px, the others stay below %.2f px",
					consensus.rms_px[i], consensus.threshold_px);
		}
		size_t outliers = views_.size() - kept.size();
		calibration_.views_used = uint32_t(kept.size());
		if (double(outliers) > kMaxOutlierShare * double(views_.size()))
			fail(DIO_REFUSED,
			     "calibration: %zu of %zu views contradict the others: keep zoom and "
			     "focus "
			     "fixed, the board flat and its specification right",
			     outliers, views_.size());
		views_ = kept;
		require_views(views_.size());
		fit_ = consensus.fit;
	}

	void fit_final()
	{
		unsigned allowed = TERMS_TANGENTIAL | (options_.fix_k3 ? TERMS_NONE : TERMS_K3);
		ask_whether_to_go_on();
		Fit fullest = fit_views(views_, size_, allowed, &fit_.lens);
		ask_whether_to_go_on();
		Uncertainty uncertainty = uncertainty_of(views_, fullest);
		unsigned terms = choose_terms(fullest, uncertainty);
		fit_ = terms == allowed ? fullest : fit_views(views_, size_, terms, &fit_.lens);
		report_fit(sigmas_of(views_, fit_, fullest, uncertainty));
		ask_whether_to_go_on();
		double sum = 0, corners = 0;
		std::vector<double> errors = heldout_errors(views_, size_, terms, 2, fit_.lens);
		for (size_t i = 0; i < views_.size(); i++) {
			sum += errors[i];
			corners += double(views_[i].image.size());
		}
		calibration_.heldout_rms_px = std::sqrt(sum / corners);
		calibration_.coverage = coverage_of(views_, size_);
		calibration_.tilt_deg = tilt_of(fit_);
	}

	void report_fit(const Parameters &sigmas)
	{
		dio_camera_model &model = calibration_.model;
		model.width = uint32_t(size_.width);
		model.height = uint32_t(size_.height);
		model.fx = fit_.lens.matrix(0, 0);
		model.fy = fit_.lens.matrix(1, 1);
		model.cx = fit_.lens.matrix(0, 2);
		model.cy = fit_.lens.matrix(1, 2);
		std::copy_n(fit_.lens.distortion.val, 5, model.dist);
		calibration_.rms_px = fit_.rms_px;

		calibration_.sigma_fx = sigmas(0);
		calibration_.sigma_fy = sigmas(1);
		calibration_.sigma_cx = sigmas(2);
		calibration_.sigma_cy = sigmas(3);
		for (int i = 0; i < 5; i++)
			calibration_.sigma_dist[i] = sigmas(4 + i);
		for (uint32_t i = 0; i < count_; i++)
			report_view(i);
	}

	/* Every picture with enough corners is measured against the final model. */
	void report_view(uint32_t i)
	{
		if (corners_[i].count < kMinCorners)
			return;
		View view = view_of(corners_[i]);
		if (!spans_plane(view))
			return;
		std::vector<PlanarPose> poses = solve_planar(view, fit_.lens);
		calibration_.views[i].rms_px = poses.empty() ? 0 : poses[0].rms_px;
	}

	void judge() const
	{
		const dio_calibration &c = calibration_;
		double diagonal = std::hypot(size_.width, size_.height);
		double sigma = std::max(c.sigma_fx / c.model.fx, c.sigma_fy / c.model.fy);
		if (c.tilt_deg < options_.min_tilt_deg)
			fail(DIO_REFUSED,
			     "calibration: the board is tilted by %.1f degrees between views, at "
			     "least %.0f "
			     "needed: tilt it to the camera, left, right, up and down",
			     c.tilt_deg, options_.min_tilt_deg);
		if (c.coverage < options_.min_coverage)
			fail(DIO_REFUSED,
			     "calibration: corners cover %.0f%% of the picture, at least %.0f%% "
			     "needed: show "
			     "the board near the edges and corners too",
			     100 * c.coverage, 100 * options_.min_coverage);
		if (!(c.rms_px <= kMaxRmsShare * diagonal))
			fail(DIO_REFUSED,
			     "calibration: reprojection error %.2f px, at most %.2f px is "
			     "plausible: is the "
			     "board's specification right, the board flat, the zoom fixed?",
			     c.rms_px, kMaxRmsShare * diagonal);
		if (!(c.heldout_rms_px <= options_.max_heldout_ratio * c.rms_px))
			fail(DIO_REFUSED,
			     "calibration: error %.2f px on views held out against %.2f px on "
			     "those fitted: "
			     "the views are too few or too alike; take more, from different sides",
			     c.heldout_rms_px, c.rms_px);
		if (!(c.model.fx > 0) || !(c.model.fy > 0) || !(sigma <= kMaxFocalSigmaShare))
			fail(DIO_REFUSED,
			     "calibration: the focal length %.1f px is known to %.1f%% only, at "
			     "most %.0f%% "
			     "wanted: take more pictures with the board tilted",
			     c.model.fx, 100 * sigma, 100 * kMaxFocalSigmaShare);
	}

	const dio_corners *corners_;
	uint32_t count_;
	cv::Size size_;
	const dio_calibration_options &options_;
	dio_calibration &calibration_;
	uint32_t min_views_;
	Views views_;
	Fit fit_;
};

} // namespace

} // namespace dio

extern "C" {

void dio_calibration_defaults(struct dio_calibration_options *options)
{
	*options = dio_calibration_options{};
	options->min_views = 6;
	options->min_tilt_deg = 15;
	options->min_coverage = 0.3;
	options->max_heldout_ratio = 2;
}

enum dio_status dio_calibrate(const struct dio_board *board, const struct dio_corners *corners,
			      uint32_t count, uint32_t width, uint32_t height,
			      const struct dio_calibration_options *options,
			      struct dio_calibration *calibration, struct dio_error *error)
{
	return dio::guarded(error, "calibration", [&] {
		if (!board || width == 0 || height == 0 || width > 65536 || height > 65536)
			dio::fail(DIO_BAD_ARG, "calibration: pictures of %ux%u pixels", width,
				  height);
		dio_calibration_options defaults;
		dio_calibration_defaults(&defaults);
		cv::Size size{int(width), int(height)};
		dio::Calibrator(corners, count, size, options ? *options : defaults, *calibration)
			.run();
	});
}

void dio_calibration_deinit(struct dio_calibration *calibration)
{
	if (!calibration)
		return;
	free(calibration->views);
	*calibration = dio_calibration{};
}

} // extern "C"
