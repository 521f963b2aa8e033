#include "viewd/machine.h"

/* One step: what it reads and what it decides. */
struct step {
	struct dio_viewd_machine *machine;
	const struct dio_viewd_facts *facts;
	uint32_t orders;
	struct dio_error *why;
};

const char *dio_viewd_state_name(enum dio_viewd_state state)
{
	static const char *const NAMES[DIO_VIEWD_STATE_COUNT] = {
		"idle", "calibrate", "capture", "reconstruct", "view", "play"};

	return (unsigned)state < DIO_VIEWD_STATE_COUNT ? NAMES[state] : "unknown";
}

enum dio_led_state dio_viewd_machine_led(const struct dio_viewd_machine *machine)
{
	static const enum dio_led_state LEDS[DIO_VIEWD_STATE_COUNT] = {
		[DIO_VIEWD_IDLE] = DIO_LED_STATE_IDLE,
		[DIO_VIEWD_CALIBRATE] = DIO_LED_STATE_CALIBRATE,
		[DIO_VIEWD_CAPTURE] = DIO_LED_STATE_CAPTURE,
		[DIO_VIEWD_RECONSTRUCT] = DIO_LED_STATE_RECONSTRUCT,
		[DIO_VIEWD_VIEW] = DIO_LED_STATE_VIEW,
		[DIO_VIEWD_PLAY] = DIO_LED_STATE_VIEW,
	};

	return machine->failed ? DIO_LED_STATE_ERROR : LEDS[machine->state];
}

static enum dio_status go(struct step *step, enum dio_viewd_state state, uint32_t orders)
{
	step->machine->state = state;
	step->machine->fitting = false;
	step->orders |= orders;
	return DIO_OK;
}

static enum dio_status ask_calibrate(struct step *step)
{
	struct dio_viewd_machine *machine = step->machine;

	if (!step->facts->board_known)
		return dio_fail(step->why, DIO_REFUSED,
				"no board to calibrate with: name one in the profile, "
				"[capture] board = charuco:...");
	if (machine->state != DIO_VIEWD_CALIBRATE)
		return go(step, DIO_VIEWD_CALIBRATE, DIO_VIEWD_BEGIN_GATHER);
	/* Asked again: fit what there is. */
	if (machine->fitting)
		return DIO_OK;
	if (step->facts->gathered == 0)
		return dio_fail(step->why, DIO_REFUSED,
				"no view of the board yet: hold it before the camera");
	machine->fitting = true;
	step->orders |= DIO_VIEWD_FIT;
	return DIO_OK;
}

/* A view on demand, while capturing. */
static enum dio_status take_view(struct step *step)
{
	if (!step->facts->camera_streaming)
		return dio_fail(step->why, DIO_REFUSED,
				"the camera delivers no pictures: is the cable in?");
	if (!step->facts->pose_known)
		return dio_fail(step->why, DIO_REFUSED,
				"no pose: the board is not in view, or too little of it");
	step->orders |= DIO_VIEWD_TAKE_VIEW;
	return DIO_OK;
}

static enum dio_status ask_capture(struct step *step)
{
	const struct dio_viewd_facts *facts = step->facts;
	bool go_on = facts->views > 0 && !facts->views_closed;

	if (step->machine->state == DIO_VIEWD_CALIBRATE)
		return dio_fail(step->why, DIO_REFUSED,
				"calibrating: finish it with calibrate, or cancel it");
	if (!facts->board_known)
		return dio_fail(step->why, DIO_REFUSED,
				"no board to find poses from: name one in the profile, "
				"[capture] board = charuco:...");
	if (!facts->calibrated)
		return dio_fail(step->why, DIO_REFUSED,
				"the camera is not calibrated: calibrate first");
	if (!facts->space_for_views)
		return dio_fail(step->why, DIO_NO_SPACE,
				"the disk has no room for a capture: free some space");
	if (step->machine->state == DIO_VIEWD_CAPTURE)
		return take_view(step);
	/* Views that no scene was made of are not thrown away. */
	return go(step, DIO_VIEWD_CAPTURE, go_on ? 0 : DIO_VIEWD_BEGIN_VIEWS);
}

static enum dio_status ask_reconstruct(struct step *step)
{
	const struct dio_viewd_facts *facts = step->facts;

	if (step->machine->state == DIO_VIEWD_CALIBRATE)
		return dio_fail(step->why, DIO_REFUSED,
				"calibrating: finish it with calibrate, or cancel it");
	if (facts->engine_opening)
		return dio_fail(step->why, DIO_BUSY,
				"the model is being opened: ask again in a moment");
	if (!facts->engine_ready)
		return dio_fail(step->why, DIO_REFUSED,
				"no model is open: see the log for what is wrong with it");
	if (facts->views < facts->views_min)
		return dio_fail(step->why, DIO_REFUSED,
				"%u views of at least %u are there: capture more", facts->views,
				facts->views_min);
	if (!facts->space_for_scene)
		return dio_fail(step->why, DIO_NO_SPACE,
				"the disk has no room for the scene: free some space");
	return go(step, DIO_VIEWD_RECONSTRUCT, DIO_VIEWD_RECONSTRUCT_NOW);
}

static enum dio_status ask_play(struct step *step)
{
	if (step->machine->state == DIO_VIEWD_CALIBRATE ||
	    step->machine->state == DIO_VIEWD_CAPTURE)
		return dio_fail(step->why, DIO_REFUSED, "%s is under way: finish or cancel it",
				dio_viewd_state_name(step->machine->state));
	if (!step->facts->scene_there)
		return dio_fail(step->why, DIO_REFUSED,
				"no scene to play: capture and reconstruct one");
	return go(step, step->machine->state == DIO_VIEWD_PLAY ? DIO_VIEWD_VIEW : DIO_VIEWD_PLAY,
		  0);
}

static enum dio_status ask_save(struct step *step)
{
	if (step->facts->views == 0)
		return dio_fail(step->why, DIO_REFUSED, "nothing to save: capture something");
	if (!step->facts->space_for_scene)
		return dio_fail(step->why, DIO_NO_SPACE,
				"the disk has no room to save: free some space");
	step->orders |= DIO_VIEWD_SAVE_NOW;
	return DIO_OK;
}

static enum dio_status ask_cancel(struct step *step)
{
	switch (step->machine->state) {
	case DIO_VIEWD_RECONSTRUCT:
		/* The engine says when it has stopped. */
		step->orders |= step->machine->cancelling ? 0 : DIO_VIEWD_CANCEL_ENGINE;
		step->machine->cancelling = true;
		return DIO_OK;
	case DIO_VIEWD_PLAY:
		return go(step, DIO_VIEWD_VIEW, 0);
	default:
		return go(step, DIO_VIEWD_IDLE, 0);
	}
}

static enum dio_status ask(struct step *step, enum dio_action action)
{
	if (step->machine->state == DIO_VIEWD_RECONSTRUCT && action != DIO_ACTION_NONE &&
	    action != DIO_ACTION_CANCEL && action != DIO_ACTION_SHUTDOWN)
		return dio_fail(step->why, DIO_BUSY,
				"a reconstruction is under way: wait for it, or cancel it");
	switch (action) {
	case DIO_ACTION_NONE:
		return DIO_OK;
	case DIO_ACTION_CALIBRATE:
		return ask_calibrate(step);
	case DIO_ACTION_CAPTURE:
		return ask_capture(step);
	case DIO_ACTION_RECONSTRUCT:
		return ask_reconstruct(step);
	case DIO_ACTION_PLAY:
		return ask_play(step);
	case DIO_ACTION_SAVE:
		return ask_save(step);
	case DIO_ACTION_CANCEL:
		return ask_cancel(step);
	case DIO_ACTION_SHUTDOWN:
		/* A reconstruction stays due: the next start takes it up. */
		step->orders |= DIO_VIEWD_QUIT;
		if (step->machine->state == DIO_VIEWD_RECONSTRUCT)
			step->orders |= DIO_VIEWD_CANCEL_ENGINE;
		return DIO_OK;
	}
	return dio_fail(step->why, DIO_BAD_ARG, "no such action");
}

/* Take up what the last run left. */
static void start(struct step *step)
{
	const struct dio_viewd_facts *facts = step->facts;

	if (facts->scene_there)
		go(step, DIO_VIEWD_VIEW, 0);
	else if (facts->reconstruct_due && facts->engine_ready && facts->views > 0 &&
		 facts->space_for_scene)
		go(step, DIO_VIEWD_RECONSTRUCT, DIO_VIEWD_RECONSTRUCT_NOW);
}

/* What the machine's own work comes to. News of work that nobody waits for any more is dropped. */
static void hear(struct step *step, enum dio_viewd_event_kind kind)
{
	struct dio_viewd_machine *machine = step->machine;

	if (kind == DIO_VIEWD_STARTED && machine->state == DIO_VIEWD_IDLE) {
		start(step);
	} else if (machine->state == DIO_VIEWD_CALIBRATE) {
		if (kind == DIO_VIEWD_GATHERED && !machine->fitting) {
			machine->fitting = true;
			step->orders |= DIO_VIEWD_FIT;
		} else if (kind == DIO_VIEWD_FITTED && machine->fitting) {
			go(step, DIO_VIEWD_IDLE, 0);
		} else if (kind == DIO_VIEWD_FIT_REFUSED) {
			machine->fitting = false;
		}
	} else if (machine->state == DIO_VIEWD_CAPTURE) {
		if (kind == DIO_VIEWD_VIEWS_FULL && ask_reconstruct(step) != DIO_OK)
			go(step, DIO_VIEWD_IDLE, 0);
		if (kind == DIO_VIEWD_STORE_FAILED) {
			machine->failed = true;
			go(step, DIO_VIEWD_IDLE, 0);
		}
	} else if (machine->state == DIO_VIEWD_RECONSTRUCT) {
		if (kind != DIO_VIEWD_RECONSTRUCTED && kind != DIO_VIEWD_CANCELLED &&
		    kind != DIO_VIEWD_ENGINE_FAILED)
			return;
		machine->cancelling = false;
		machine->failed = kind == DIO_VIEWD_ENGINE_FAILED;
		go(step, kind == DIO_VIEWD_RECONSTRUCTED ? DIO_VIEWD_VIEW : DIO_VIEWD_IDLE, 0);
	} else if (kind == DIO_VIEWD_ENGINE_FAILED && machine->state != DIO_VIEWD_IDLE) {
		machine->failed = true;
		go(step, DIO_VIEWD_IDLE, 0);
	}
}

enum dio_status dio_viewd_machine_step(struct dio_viewd_machine *machine,
				       const struct dio_viewd_event *event,
				       const struct dio_viewd_facts *facts, uint32_t *orders,
				       struct dio_error *why)
{
	struct step step = {.machine = machine, .facts = facts, .why = why};
	enum dio_status status = DIO_OK;

	if (event->kind != DIO_VIEWD_ASKED)
		hear(&step, event->kind);
	else
		status = ask(&step, event->action);
	if (event->kind == DIO_VIEWD_ASKED && event->action != DIO_ACTION_NONE)
		machine->failed = status != DIO_OK;
	*orders = step.orders;
	return status;
}
