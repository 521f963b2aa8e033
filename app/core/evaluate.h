/* How near rendered targets come to the true pictures, beside the nearest-view baseline. */
#ifndef DIO_APP_EVALUATE_H
#define DIO_APP_EVALUATE_H

#include "core/session.h"

/** One target. The picture scored is the 8-bit one that render would write. */
struct dio_score {
	uint32_t target;  /* index in the view set */
	uint32_t nearest; /* index of the context view of the baseline */
	double psnr_db, ssim;
	double nearest_psnr_db, nearest_ssim; /* NaN when its picture has another size */
	uint64_t render_ns;
	struct dio_picture rendered;
};

/** All targets that have a picture. Release with dio_evaluation_deinit(). */
struct dio_evaluation {
	struct dio_score *scores;
	uint32_t count;
	double psnr_db, ssim, nearest_psnr_db, nearest_ssim; /* means */
	struct dvsm_stats reconstruct;
	uint64_t render_ns; /* mean */
};

/** Reconstruct from the set's context views and score its targets. DIO_BAD_ARG: no target has a
 * picture. */
enum dio_status dio_evaluate(struct dio_session *session, const struct dio_view_set *set,
			     struct dio_evaluation *evaluation, struct dio_error *error);
void dio_evaluation_deinit(struct dio_evaluation *evaluation);

#endif
