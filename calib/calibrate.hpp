/* The parts of an intrinsics calibration. */
#ifndef DIO_CALIB_CALIBRATE_HPP
#define DIO_CALIB_CALIBRATE_HPP

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

/* calibrate_uncertainty.cpp */

/** fx, fy, cx, cy, k1, k2, p1, p2, k3. */
using Parameters = cv::Vec<double, 9>;
using Covariance = cv::Matx<double, 9, 9>;

struct Uncertainty {
	Covariance covariance;   /* rows and columns of terms not estimated are 0 */
	double measurements = 0; /* independent ones that the corners are worth */
};

/**
 * Covariance of a fit's parameters from its residuals, poses free. Where the views contradict each
 * other by more than their corners' noise explains, it is larger by as much.
 */
Uncertainty uncertainty_of(const Views &views, const Fit &fit);

/**
 * The terms of the fullest fit that the views give evidence for, by Schwarz's criterion (BIC) in
 * Wald's form: what leaving terms out adds to chi-square against ln(measurements) for each.
 */
unsigned choose_terms(const Fit &fullest, const Uncertainty &uncertainty);

/**
 * One standard deviation of each parameter of `fit`, whose terms were chosen from the fullest fit.
 * A term left out is unproved, not known to be zero: a sigma is never below the fullest fit's, nor
 * below the distance the choice moved the parameter.
 */
Parameters sigmas_of(const Views &views, const Fit &fit, const Fit &fullest,
		     const Uncertainty &of_fullest);

/* calibrate_views.cpp */

/** A view that repeats an earlier one of `views` within a fraction of the picture. -1: none. */
int find_duplicate(const Views &views, const View &view, cv::Size size);

double coverage_of(const Views &views, cv::Size size);
double tilt_of(const Fit &fit);

struct Consensus {
	std::vector<bool> used;     /* [views] */
	std::vector<double> rms_px; /* [views] under the final lens */
	double threshold_px = 0;
	Fit fit; /* of the used views */
};

/** Fit, leave out views far above the others, fit again, until nothing changes. */
Consensus find_consensus(const Views &views, cv::Size size, size_t min_views);

} // namespace dio

#endif
