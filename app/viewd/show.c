/* The display loop: viewpoint, rendered picture, display's picture, flip. Each stage has one
 * picture under way at most, and what comes meanwhile gives way to what is newer. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/clock.h"
#include "viewd/jobs.h"

#define RATE_DEFAULT 30.0

static bool shows_scene(const struct dio_viewd *viewd)
{
	return viewd->scene_there &&
	       (viewd->machine.state == DIO_VIEWD_VIEW || viewd->machine.state == DIO_VIEWD_PLAY);
}

static bool has_display(const struct dio_viewd *viewd)
{
	return viewd->display && viewd->display_info.state == DIO_DISPLAY_ON;
}

/* Does anybody see what would be shown? */
static bool is_watched(const struct dio_viewd *viewd)
{
	return has_display(viewd) || dio_viewd_page_is_watched(viewd);
}

static uint64_t frame_time_ns(const struct dio_viewd *viewd)
{
	double rate = viewd->display_info.refresh_hz;

	if (!(rate > 0))
		rate = viewd->profile->display.frames_per_second;
	return (uint64_t)(1e9 / (rate > 0 ? fmin(rate, 120) : RATE_DEFAULT));
}

/* Words for the picture that is about to be shown. */
static void describe(const struct dio_viewd *viewd, struct dio_overlay *overlay)
{
	const struct dio_viewd_status *status = &viewd->status;
	const struct dio_corners *corners = &viewd->tracked.corners;
	enum dio_viewd_state state = viewd->machine.state;

	*overlay = (struct dio_overlay){.progress = -1, .alarm = status->alarm};
	snprintf(overlay->state, sizeof overlay->state, "%s", dio_viewd_state_name(state));
	snprintf(overlay->message, sizeof overlay->message, "%.150s", status->message);
	snprintf(overlay->figures, sizeof overlay->figures, "%.0f fps  %.0f ms (p99 %.0f)",
		 status->fps, status->latency_ms, status->latency_p99_ms);
	if (viewd->tracked.camera != DIO_CAPTURE_STREAMING)
		snprintf(overlay->lines[2], sizeof overlay->lines[2], "camera: %s", status->camera);
	if (state == DIO_VIEWD_CALIBRATE) {
		snprintf(overlay->lines[0], sizeof overlay->lines[0], "%u views, coverage %.0f %%",
			 status->gathered, status->coverage * 100);
		overlay->show_cells = true;
		memcpy(overlay->cells, viewd->gathered.cells, sizeof overlay->cells);
	} else if (state == DIO_VIEWD_CAPTURE) {
		snprintf(overlay->lines[0], sizeof overlay->lines[0], "%u views of %u to %u",
			 status->views, status->views_min, status->views_max);
		snprintf(overlay->lines[1], sizeof overlay->lines[1], "%s", status->verdict);
	} else if (state == DIO_VIEWD_RECONSTRUCT) {
		overlay->progress = status->progress;
	} else if (shows_scene(viewd)) {
		snprintf(overlay->lines[0], sizeof overlay->lines[0], "%s, %.0f ms, patch %u",
			 status->source, status->render_ms, status->patch_px);
	}
	if (state != DIO_VIEWD_CALIBRATE && state != DIO_VIEWD_CAPTURE)
		return;
	for (uint32_t i = 0; i < corners->count && i < DIO_OVERLAY_CORNERS; i++) {
		overlay->corners[i][0] =
			(corners->image_px[i][0] + 0.5f) / (float)viewd->tracked.picture.width;
		overlay->corners[i][1] =
			(corners->image_px[i][1] + 0.5f) / (float)viewd->tracked.picture.height;
		overlay->corner_count = i + 1;
	}
}

static enum dio_status run_compose(struct dio_job *base, struct dio_error *error)
{
	struct dio_viewd_compose *compose = (struct dio_viewd_compose *)base;

	return dio_screen_compose(&compose->screen, &compose->source, compose->width,
				  compose->height, compose->smooth,
				  compose->with_overlay ? &compose->overlay : NULL, error);
}

static void compose(struct dio_viewd *viewd);

static void done_compose(struct dio_job *base)
{
	struct dio_viewd_compose *compose_job = (struct dio_viewd_compose *)base;
	struct dio_viewd *viewd = base->owner;
	struct dio_error why = {""};
	uint64_t tag = viewd->next_tag;
	enum dio_status status = base->status;

	compose_job->busy = false;
	if (viewd->quitting)
		return;
	if (status == DIO_OK && viewd->display) {
		viewd->tags_taken_ns[tag % DIO_VIEWD_TAGS] = compose_job->taken_ns;
		viewd->next_tag++;
		status = dio_display_show(viewd->display, &compose_job->screen.canvas, tag, &why);
	}
	/* Off is a state. What else went wrong shows on the display's next event. */
	if (status != DIO_OK && status != DIO_NO_SIGNAL)
		dio_viewd_say(viewd, true, "%s", *why.text ? why.text : base->error.text);
	if (viewd->picture_waits)
		compose(viewd);
}

const struct dio_picture *dio_viewd_get_shown(const struct dio_viewd *viewd)
{
	const struct dio_picture *shown = shows_scene(viewd) && viewd->shot.is_there
						  ? &viewd->shot.picture
						  : &viewd->tracked.picture;

	return shown->rgb ? shown : NULL;
}

bool dio_viewd_copy_picture(const struct dio_picture *from, struct dio_picture *to)
{
	if (to->width != from->width || to->height != from->height) {
		dio_picture_deinit(to);
		if (dio_picture_init(to, from->width, from->height) != DIO_OK)
			return false;
	}
	memcpy(to->rgb, from->rgb, (size_t)from->width * from->height * 3);
	return true;
}

/* Send what the state shows to the display: the last rendered picture, or the camera's. */
static void compose(struct dio_viewd *viewd)
{
	struct dio_viewd_compose *job = &viewd->compose;
	const struct dio_picture *shown = dio_viewd_get_shown(viewd);
	uint64_t taken_ns;

	viewd->composed = true;
	viewd->page.stale = true;
	if (!has_display(viewd))
		return;
	viewd->picture_waits = job->busy;
	if (job->busy || (shown && !dio_viewd_copy_picture(shown, &job->source)))
		return;
	if (!shown)
		dio_picture_deinit(&job->source);
	job->width = viewd->display_info.width;
	job->height = viewd->display_info.height;
	job->smooth = viewd->profile->display.smooth;
	job->with_overlay = viewd->profile->display.overlay;
	taken_ns =
		shown == &viewd->shot.picture ? viewd->shot.taken_ns : viewd->tracked.timestamp_ns;
	/* A picture that is shown again says nothing about latency. */
	job->taken_ns = taken_ns != viewd->composed_taken_ns ? taken_ns : 0;
	viewd->composed_taken_ns = taken_ns;
	if (job->with_overlay)
		describe(viewd, &job->overlay);
	job->busy = true;
	dio_viewd_post(viewd, viewd->screen, &job->job, run_compose, done_compose);
}

/* On the engine's thread: the session is its own, the rest of the job too. */
static enum dio_status run_render(struct dio_job *base, struct dio_error *error)
{
	struct dio_viewd_render *render = (struct dio_viewd_render *)base;
	struct dio_viewd *viewd = base->owner;
	struct dvsm_stats stats = {0};
	enum dio_status status;

	dio_session_set_patch_render(viewd->session, render->patch_px);
	status = dio_session_render_picture(viewd->session, &render->camera, &render->pose,
					    &render->picture, &stats, error);
	render->time_ns = stats.time_ns;
	return status;
}

static void done_render(struct dio_job *base)
{
	struct dio_viewd_render *render = (struct dio_viewd_render *)base;
	struct dio_viewd *viewd = base->owner;
	struct dio_picture former = viewd->shot.picture;

	render->busy = false;
	if (viewd->quitting)
		return;
	if (base->status != DIO_OK) {
		dio_viewd_tell(viewd, DIO_VIEWD_ENGINE_FAILED);
		dio_viewd_say(viewd, true, "rendering failed: %s", base->error.text);
		return;
	}
	dio_pace_note(&viewd->pace, render->time_ns);
	viewd->status.render_ms = (double)render->time_ns * 1e-6;
	viewd->shot = (struct dio_viewd_shot){.is_there = true,
					      .taken_ns = render->taken_ns,
					      .picture = render->picture,
					      .camera = render->camera,
					      .pose = render->pose};
	render->picture = former;
	compose(viewd);
	dio_viewd_show(viewd);
}

/* What a tracked viewpoint is seen with; without a calibration, what the scene was seen with. */
static const struct dio_camera_model *render_camera(const struct dio_viewd *viewd)
{
	return viewd->calibrated ? &viewd->pinhole : &viewd->scene_camera;
}

static void render_next(struct dio_viewd *viewd)
{
	struct dio_viewd_render *render = &viewd->render;
	uint64_t now_ns = dio_clock_ns(), taken_ns;
	enum dio_viewpoint_source source;
	struct dio_pose pose;

	if (render->busy)
		return;
	source = dio_viewpoint_get(&viewd->viewpoint, now_ns, &pose, &taken_ns);
	snprintf(viewd->status.source, sizeof viewd->status.source, "%s",
		 dio_viewpoint_source_name(source));
	/* A tracked viewpoint is worth one picture; the others change with time. */
	if (source == DIO_VIEWPOINT_TRACKED ? taken_ns == viewd->rendered_taken_ns
					    : now_ns < viewd->next_frame_ns)
		return;
	if (source == DIO_VIEWPOINT_HAND && !viewd->turned)
		return;
	viewd->turned = false;
	viewd->rendered_taken_ns = taken_ns;
	viewd->next_frame_ns = now_ns + frame_time_ns(viewd);
	render->camera = *render_camera(viewd);
	render->pose = pose;
	render->taken_ns = taken_ns;
	render->patch_px = dio_pace_get_patch(&viewd->pace);
	viewd->status.patch_px = render->patch_px;
	render->busy = true;
	dio_viewd_post(viewd, viewd->engine, &render->job, run_render, done_render);
}

static int on_frame_due(sd_event_source *source, uint64_t now_us, void *context)
{
	(void)source;
	(void)now_us;
	dio_viewd_show(context);
	return 0;
}

/* Come back when the next picture of an orbit or a path is due. */
static void wait_for_frame(struct dio_viewd *viewd)
{
	if (!viewd->frame_source &&
	    sd_event_add_time(viewd->loop, &viewd->frame_source, CLOCK_MONOTONIC, 0, 500,
			      on_frame_due, viewd) < 0)
		return;
	sd_event_source_set_time(viewd->frame_source, viewd->next_frame_ns / 1000 + 1);
	sd_event_source_set_enabled(viewd->frame_source, SD_EVENT_ONESHOT);
}

void dio_viewd_show(struct dio_viewd *viewd)
{
	if (viewd->quitting || !viewd->engine_ready || !shows_scene(viewd) || !is_watched(viewd))
		return;
	render_next(viewd);
	if (!viewd->render.busy && dio_clock_ns() < viewd->next_frame_ns)
		wait_for_frame(viewd);
}

void dio_viewd_show_camera(struct dio_viewd *viewd)
{
	if (shows_scene(viewd))
		dio_viewd_show(viewd);
	else
		compose(viewd);
}

void dio_viewd_show_again(struct dio_viewd *viewd)
{
	if (!viewd->quitting)
		compose(viewd);
}

void dio_viewd_show_tick(struct dio_viewd *viewd)
{
	dio_viewd_show(viewd);
	if (!viewd->composed)
		dio_viewd_show_again(viewd);
	viewd->composed = false;
}

static enum dio_status need_scene(const struct dio_viewd *viewd, struct dio_error *error)
{
	return shows_scene(viewd) ? DIO_OK
				  : dio_fail(error, DIO_REFUSED,
					     "no scene is shown: capture and reconstruct one");
}

enum dio_status dio_viewd_turn(struct dio_viewd *viewd, double azimuth, double elevation,
			       double notches, struct dio_error *error)
{
	enum dio_status status = need_scene(viewd, error);

	if (status == DIO_OK &&
	    !(fabs(azimuth) <= 10 && fabs(elevation) <= 10 && fabs(notches) <= 100))
		status = dio_fail(error, DIO_BAD_ARG,
				  "turn by at most 10 radians and 100 notches at once");
	if (status != DIO_OK)
		return status;
	dio_viewpoint_turn(&viewd->viewpoint, azimuth, elevation, notches);
	viewd->turned = true;
	dio_viewd_show(viewd);
	return DIO_OK;
}

enum dio_status dio_viewd_follow(struct dio_viewd *viewd, struct dio_error *error)
{
	enum dio_status status = need_scene(viewd, error);

	if (status != DIO_OK)
		return status;
	dio_viewpoint_follow(&viewd->viewpoint);
	viewd->rendered_taken_ns = 0;
	dio_viewd_show(viewd);
	return DIO_OK;
}

void dio_viewd_release_pictures(struct dio_viewd *viewd)
{
	sd_event_source_unref(viewd->frame_source);
	viewd->frame_source = NULL;
	dio_picture_deinit(&viewd->render.picture);
	dio_picture_deinit(&viewd->shot.picture);
	dio_picture_deinit(&viewd->compose.source);
	dio_screen_deinit(&viewd->compose.screen);
}
