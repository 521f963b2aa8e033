/* What is made of the tracker's results: views of the board, keyframes, the tracked viewpoint. */
#include <stdio.h>

#include "dio/clock.h"
#include "viewd/viewd.h"

#define WALK_MAX 36000u /* poses: twenty minutes at 30 a second */

/* Note where the camera went; a walk too long keeps every second pose. */
static void note_walk(struct dio_viewd *viewd)
{
	struct dio_trajectory *walk = &viewd->walk;

	if (walk->count == 0 && dio_trajectory_init(walk, WALK_MAX) != DIO_OK)
		return;
	if (viewd->walk_count == WALK_MAX) {
		viewd->walk_count /= 2;
		for (uint32_t i = 0; i < viewd->walk_count; i++) {
			walk->poses[i] = walk->poses[2 * i];
			walk->time_s[i] = walk->time_s[2 * i];
		}
	}
	walk->poses[viewd->walk_count] = viewd->tracked.estimate.pose;
	walk->time_s[viewd->walk_count++] = (double)viewd->tracked.timestamp_ns * 1e-9;
}

/* Is this picture worth keeping? Says what came of it. */
static void choose(struct dio_viewd *viewd)
{
	/* The board's centre: the scene lies on and round it. */
	static const double CENTRE[3] = {0, 0, 0};
	struct dio_tracked *tracked = &viewd->tracked;
	struct dio_keyframes *keyframes = &viewd->keyframes;
	bool usable = tracked->undistorted_known &&
		      dio_camera_model_equal(&tracked->pinhole, &viewd->pinhole);
	enum dio_keyframe_verdict verdict = dio_keyframe_judge(
		keyframes, &tracked->quality, usable ? &tracked->estimate.pose : NULL, CENTRE,
		tracked->timestamp_ns);

	snprintf(viewd->status.verdict, sizeof viewd->status.verdict, "%s",
		 dio_keyframe_verdict_name(verdict));
	if (usable)
		note_walk(viewd);
	if (verdict == DIO_KEYFRAME_FULL) {
		dio_viewd_tell(viewd, DIO_VIEWD_VIEWS_FULL);
		return;
	}
	if (!usable || (verdict != DIO_KEYFRAME_KEPT && !viewd->take_now))
		return;
	viewd->take_now = false;
	if (dio_keyframe_keep(keyframes, &tracked->estimate.pose))
		dio_viewd_store_view(viewd);
	else
		dio_viewd_say(viewd, true, "no memory for another view");
}

void dio_viewd_look(struct dio_viewd *viewd)
{
	struct dio_tracked *tracked = &viewd->tracked;
	enum dio_capture_state before = tracked->camera;

	if (viewd->quitting || !dio_tracker_take(viewd->tracker, tracked))
		return;
	if (tracked->camera != before && tracked->camera != DIO_CAPTURE_STREAMING)
		dio_viewd_say(viewd, true, "camera: %s%s%s",
			      dio_capture_state_name(tracked->camera),
			      *tracked->camera_text ? ": " : "", tracked->camera_text);
	else if (tracked->camera != before && viewd->status.alarm)
		dio_viewd_say(viewd, false, "camera: %s", dio_capture_state_name(tracked->camera));
	if (*tracked->fault)
		dio_viewd_say(viewd, true, "%s", tracked->fault);
	if (!tracked->fresh)
		return;
	if (viewd->machine.state == DIO_VIEWD_CALIBRATE && tracked->task == DIO_TRACKER_FIND)
		dio_viewd_gather(viewd);
	else if (viewd->machine.state == DIO_VIEWD_CAPTURE && tracked->task == DIO_TRACKER_CAPTURE)
		choose(viewd);
	else if (viewd->machine.state == DIO_VIEWD_VIEW && tracked->pose_known)
		dio_viewpoint_track(&viewd->viewpoint, &tracked->estimate.pose,
				    tracked->timestamp_ns, dio_clock_ns());
	dio_viewd_show_camera(viewd);
}
