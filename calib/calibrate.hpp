/* The parts of an intrinsics calibration. */
#ifndef DIO_CALIB_CALIBRATE_HPP
#define DIO_CALIB_CALIBRATE_HPP

#include <array>
#include <vector>

#include <opencv2/core.hpp>

#include "dio/calibration.h"
#include "planar.hpp"

namespace dio
{

using Views = std::vector<View>;

/** Distortion terms beyond k1, k2, which are always estimated. */
enum Terms : unsigned { TERMS_NONE = 0, TERMS_TANGENTIAL = 1, TERMS_K3 = 2 };

struct Fit {
	Lens lens;
	unsigned terms = TERMS_NONE;
	std::vector<PlanarPose> poses; /* one a view */
	double rms_px = 0;
};

/* calibrate_fit.cpp */

/** Least squares over all views. `start` is NULL or a lens to begin from. */
Fit fit_views(const Views &views, cv::Size size, unsigned terms, const Lens *start);

/**
 * Squared error of each view (sum over its corners) under a lens fitted without it, the views dealt
 * into `folds` parts; the pose of a tested view is fitted to itself. Infinite where a fit fails.
 */
std::vector<double> heldout_errors(const Views &views, cv::Size size, unsigned terms, int folds,
				   const Lens &start);

/**
 * Distortion terms that pay: starting from k1, k2, a term is added when it lowers the held-out
 * error of the views by more than two standard errors of that gain. Terms that only chase noise
 * would move the focal length with them.
 */
unsigned choose_terms(const Views &views, cv::Size size, unsigned allowed, const Lens &start);

/** One standard deviation of fx, fy, cx, cy, k1, k2, p1, p2, k3; 0 for terms not estimated. */
std::array<double, 9> parameter_sigmas(const Views &views, const Fit &fit);

/* calibrate_views.cpp */

/** A view that repeats an earlier one of `views` within a fraction of the picture. -1: none. */
int find_duplicate(const Views &views, const View &view, cv::Size size);

double coverage_of(const Views &views, cv::Size size);
double tilt_of(const Fit &fit);

struct Consensus {
	std::vector<bool> used;	    /* [views] */
	std::vector<double> rms_px; /* [views] under the final lens */
	double threshold_px = 0;
	Fit fit; /* of the used views */
};

/** Fit, leave out views far above the others, fit again, until nothing changes. */
Consensus find_consensus(const Views &views, cv::Size size, size_t min_views);

} // namespace dio

#endif
