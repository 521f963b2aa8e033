#include "core/evaluate.h"

#include <math.h>
#include <stdlib.h>

#include "core/progress.h"
#include "dio/pose.h"

static uint32_t count_pictures(const struct dio_view_set *set)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < set->target_count; i++)
		count += set->target[i].picture.rgb != NULL;
	return count;
}

static enum dio_status score_target(struct dio_session *session, const struct dio_view_set *set,
				    uint32_t target, struct dio_score *score,
				    struct dio_error *error)
{
	const struct dio_view *view = &set->target[target];
	const struct dio_picture *nearest;
	struct dvsm_stats stats = {0};
	enum dio_status status;

	score->target = target;
	score->nearest = dio_view_nearest(set, &view->pose);
	nearest = &set->context[score->nearest].picture;
	status = dio_session_render_picture(session, &view->camera, &view->pose, &score->rendered,
					    &stats, error);
	if (status != DIO_OK)
		return status;
	score->render_ns = stats.time_ns;
	score->psnr_db = dio_metrics_psnr(&score->rendered, &view->picture);
	score->ssim = dio_metrics_ssim(&score->rendered, &view->picture);
	score->nearest_psnr_db = score->nearest_ssim = NAN;
	if (nearest->width == view->picture.width && nearest->height == view->picture.height) {
		score->nearest_psnr_db = dio_metrics_psnr(nearest, &view->picture);
		score->nearest_ssim = dio_metrics_ssim(nearest, &view->picture);
	}
	return DIO_OK;
}

static void average(struct dio_evaluation *evaluation)
{
	double share = 1.0 / evaluation->count, render_ns = 0;

	for (uint32_t i = 0; i < evaluation->count; i++) {
		const struct dio_score *score = &evaluation->scores[i];

		evaluation->psnr_db += share * score->psnr_db;
		evaluation->ssim += share * score->ssim;
		evaluation->nearest_psnr_db += share * score->nearest_psnr_db;
		evaluation->nearest_ssim += share * score->nearest_ssim;
		render_ns += share * (double)score->render_ns;
	}
	evaluation->render_ns = (uint64_t)render_ns;
}

enum dio_status dio_evaluate(struct dio_session *session, const struct dio_view_set *set,
			     struct dio_evaluation *evaluation, struct dio_error *error)
{
	uint32_t pictures = count_pictures(set);
	struct dio_evaluation made = {0};
	struct dio_progress progress;
	enum dio_status status;

	if (pictures == 0)
		return dio_fail(error, DIO_BAD_ARG,
				"no target has a picture to compare with: give frames role "
				"\"target\" and a file");
	made.scores = calloc(pictures, sizeof *made.scores);
	if (!made.scores)
		return dio_fail(error, DIO_NO_MEM, "no memory for %u scores", pictures);
	status = dio_session_reconstruct(session, set->context, set->context_count,
					 &made.reconstruct, error);
	dio_progress_init(&progress, "rendering");
	for (uint32_t i = 0; status == DIO_OK && i < set->target_count; i++) {
		dio_progress_update(&progress, (double)i / set->target_count);
		if (!set->target[i].picture.rgb)
			continue;
		status = score_target(session, set, i, &made.scores[made.count++], error);
	}
	dio_progress_done(&progress);
	if (status != DIO_OK) {
		dio_evaluation_deinit(&made);
		return status;
	}
	average(&made);
	*evaluation = made;
	return DIO_OK;
}

void dio_evaluation_deinit(struct dio_evaluation *evaluation)
{
	for (uint32_t i = 0; i < evaluation->count; i++)
		dio_picture_deinit(&evaluation->scores[i].rendered);
	free(evaluation->scores);
	*evaluation = (struct dio_evaluation){0};
}
