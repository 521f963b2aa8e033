/* The machine: events and facts go in, its orders are carried out. */
#include "dio/clock.h"
#include "viewd/viewd.h"

static bool has_space(const struct dio_viewd *viewd, uint64_t bytes)
{
	struct dio_error ignored;

	return dio_store_check_space(viewd->store, bytes, &ignored) == DIO_OK;
}

static struct dio_viewd_facts gather_facts(const struct dio_viewd *viewd)
{
	const struct dio_profile *profile = viewd->profile;
	uint64_t picture =
		(uint64_t)profile->engine.render_width * profile->engine.render_height * 4;

	return (struct dio_viewd_facts){
		.board_known = viewd->has_board,
		.calibrated = viewd->calibrated,
		.engine_opening = viewd->engine_opening,
		.engine_ready = viewd->engine_ready,
		.camera_streaming = viewd->tracked.camera == DIO_CAPTURE_STREAMING,
		.pose_known = viewd->tracked.undistorted_known,
		.scene_there = viewd->scene_there,
		.views_closed = viewd->views_closed,
		.reconstruct_due = viewd->due_at_start,
		.space_for_views = has_space(viewd, picture * profile->capture.views_max),
		.space_for_scene = has_space(viewd, dio_viewd_scene_bytes(viewd)),
		.gathered = viewd->gathered.count,
		.views = viewd->views,
		.views_min = profile->capture.views_min,
	};
}

/* What a state looks for in the camera's pictures. */
static void set_task(struct dio_viewd *viewd)
{
	static const enum dio_tracker_task TASKS[DIO_VIEWD_STATE_COUNT] = {
		[DIO_VIEWD_IDLE] = DIO_TRACKER_LOOK,
		[DIO_VIEWD_CALIBRATE] = DIO_TRACKER_FIND,
		[DIO_VIEWD_CAPTURE] = DIO_TRACKER_CAPTURE,
		[DIO_VIEWD_RECONSTRUCT] = DIO_TRACKER_LOOK,
		[DIO_VIEWD_VIEW] = DIO_TRACKER_TRACK,
		[DIO_VIEWD_PLAY] = DIO_TRACKER_LOOK,
	};

	dio_tracker_set_task(viewd->tracker, TASKS[viewd->machine.state]);
}

void dio_viewd_greet(struct dio_viewd *viewd)
{
	switch (viewd->machine.state) {
	case DIO_VIEWD_IDLE:
		dio_viewd_say(viewd, false, "%s",
			      viewd->calibrated ? "ready" : "ready; the camera is not calibrated");
		break;
	case DIO_VIEWD_CALIBRATE:
		dio_viewd_say(viewd, false,
			      "calibrating: show the board near, far, tilted, into the corners");
		break;
	case DIO_VIEWD_CAPTURE:
		dio_viewd_say(viewd, false, "capturing: walk the camera round the scene");
		break;
	case DIO_VIEWD_RECONSTRUCT:
		dio_viewd_say(viewd, false, "reconstructing from %u views", viewd->views);
		break;
	case DIO_VIEWD_VIEW:
		dio_viewd_say(viewd, false, "viewing");
		break;
	case DIO_VIEWD_PLAY:
		dio_viewd_say(viewd, false, "playing");
		break;
	case DIO_VIEWD_STATE_COUNT:
		break;
	}
}

static void enter_state(struct dio_viewd *viewd, bool says)
{
	dio_figures_clear(&viewd->figures);
	set_task(viewd);
	if (viewd->machine.state != DIO_VIEWD_CALIBRATE)
		atomic_fetch_add(&viewd->fit_number, 1); /* cancelled, if one is under way */
	dio_viewpoint_play(&viewd->viewpoint, viewd->machine.state == DIO_VIEWD_PLAY,
			   dio_clock_ns());
	viewd->rendered_taken_ns = 0;
	viewd->take_now = false;
	if (says)
		dio_viewd_greet(viewd);
}

static void carry_out(struct dio_viewd *viewd, uint32_t orders)
{
	if (orders & DIO_VIEWD_CANCEL_ENGINE)
		atomic_store(&viewd->cancel, true);
	if (orders & DIO_VIEWD_BEGIN_GATHER)
		dio_viewd_begin_gather(viewd);
	if (orders & DIO_VIEWD_FIT)
		dio_viewd_fit(viewd);
	if (orders & DIO_VIEWD_BEGIN_VIEWS)
		dio_viewd_begin_views(viewd);
	if (orders & DIO_VIEWD_TAKE_VIEW)
		viewd->take_now = true;
	if (orders & DIO_VIEWD_RECONSTRUCT_NOW)
		dio_viewd_reconstruct(viewd);
	if (orders & DIO_VIEWD_QUIT) {
		viewd->quitting = true;
		sd_event_exit(viewd->loop, 0);
	}
}

static enum dio_status step(struct dio_viewd *viewd, const struct dio_viewd_event *event,
			    uint32_t *orders, struct dio_error *error)
{
	const struct dio_viewd_facts facts = gather_facts(viewd);
	enum dio_viewd_state before = viewd->machine.state;
	enum dio_status status =
		dio_viewd_machine_step(&viewd->machine, event, &facts, orders, error);

	/* News that change the state bring their own message. */
	if (viewd->machine.state != before)
		enter_state(viewd, event->kind == DIO_VIEWD_ASKED ||
					   event->kind == DIO_VIEWD_STARTED ||
					   event->kind == DIO_VIEWD_VIEWS_FULL);
	carry_out(viewd, *orders);
	viewd->news = true;
	return status;
}

enum dio_status dio_viewd_ask(struct dio_viewd *viewd, enum dio_action action,
			      struct dio_error *error)
{
	const struct dio_viewd_event event = {.kind = DIO_VIEWD_ASKED, .action = action};
	struct dio_error why = {""};
	uint32_t orders = 0;
	enum dio_status status = step(viewd, &event, &orders, &why);

	if (status != DIO_OK) {
		dio_viewd_say(viewd, true, "%s", why.text);
		return dio_fail(error, status, "%s", why.text);
	}
	if (orders & DIO_VIEWD_QUIT)
		viewd->power_off = true;
	return DIO_OK;
}

void dio_viewd_take_event(struct dio_viewd *viewd, enum dio_viewd_event_kind kind)
{
	const struct dio_viewd_event event = {.kind = kind};
	struct dio_error ignored;
	uint32_t orders = 0;

	step(viewd, &event, &orders, &ignored);
}
