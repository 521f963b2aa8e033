/* org.diorama.View1: methods for what the buttons do, properties for what the overlay shows. */
#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "core/log.h"
#include "dio/clock.h"
#include "viewd/viewd.h"

#define ACTION       "org.diorama.view.control"
#define ACTION_POWER "org.diorama.view.shutdown"

/* Property, signature, field of struct dio_viewd_status. */
#define PROPERTIES(X)                                                                              \
	X("State", "s", state)                                                                     \
	X("Message", "s", message)                                                                 \
	X("Alarm", "b", alarm)                                                                     \
	X("Camera", "s", camera)                                                                   \
	X("Display", "s", display)                                                                 \
	X("Model", "s", model)                                                                     \
	X("Calibrated", "b", calibrated)                                                           \
	X("Tracking", "b", tracking)                                                               \
	X("BoardViews", "u", gathered)                                                             \
	X("Coverage", "d", coverage)                                                               \
	X("Views", "u", views)                                                                     \
	X("ViewsMin", "u", views_min)                                                              \
	X("ViewsMax", "u", views_max)                                                              \
	X("Skipped", "a{su}", skipped)                                                             \
	X("Verdict", "s", verdict)                                                                 \
	X("Progress", "d", progress)                                                               \
	X("Scene", "b", scene)                                                                     \
	X("Source", "s", source)                                                                   \
	X("Fps", "d", fps)                                                                         \
	X("LatencyMs", "d", latency_ms)                                                            \
	X("LatencyP99Ms", "d", latency_p99_ms)                                                     \
	X("RenderMs", "d", render_ms)                                                              \
	X("TrackMs", "d", track_ms)                                                                \
	X("PatchPx", "u", patch_px)                                                                \
	X("FirstShownTimestampMonotonic", "t", first_shown_us)

static const struct {
	const char *name;
	size_t offset, size;
} FIELDS[] = {
#define FIELD(name, signature, field)                                                              \
	{name, offsetof(struct dio_viewd_status, field),                                           \
	 sizeof(((struct dio_viewd_status *)0)->field)},
	PROPERTIES(FIELD)
#undef FIELD
};

/* How many pictures were passed over, by reason. */
static int append_skipped(sd_bus_message *reply, const uint32_t *skipped)
{
	int result = sd_bus_message_open_container(reply, 'a', "{su}");

	for (int i = 0; result >= 0 && i < DIO_KEYFRAME_VERDICTS; i++)
		if (i != DIO_KEYFRAME_KEPT && skipped[i] > 0)
			result = sd_bus_message_append(
				reply, "{su}",
				dio_keyframe_verdict_name((enum dio_keyframe_verdict)i),
				skipped[i]);
	return result < 0 ? result : sd_bus_message_close_container(reply);
}

/* sd-bus hands over the field itself. */
static int on_get(sd_bus *bus, const char *path, const char *interface, const char *property,
		  sd_bus_message *reply, void *field, sd_bus_error *error)
{
	(void)bus;
	(void)path;
	(void)interface;
	(void)error;
#define APPEND(name, signature, field_name)                                                        \
	if (strcmp(property, name) == 0)                                                           \
		return strcmp(signature, "a{su}") == 0                                             \
			       ? append_skipped(reply, field)                                      \
			       : sd_bus_message_append_basic(reply, (signature)[0], field);
	PROPERTIES(APPEND)
#undef APPEND
	return -ENOENT;
}

/* What a method without arguments asks for. */
static enum dio_action action_of(const char *member)
{
	static const struct {
		const char *member;
		enum dio_action action;
	} METHODS[] = {
		{"Calibrate", DIO_ACTION_CALIBRATE},     {"CaptureView", DIO_ACTION_CAPTURE},
		{"Reconstruct", DIO_ACTION_RECONSTRUCT}, {"Play", DIO_ACTION_PLAY},
		{"Cancel", DIO_ACTION_CANCEL},           {"Shutdown", DIO_ACTION_SHUTDOWN},
	};

	for (size_t i = 0; i < sizeof METHODS / sizeof *METHODS; i++)
		if (strcmp(member, METHODS[i].member) == 0)
			return METHODS[i].action;
	return DIO_ACTION_NONE;
}

static int on_action(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_viewd *viewd = context;
	enum dio_action action = action_of(sd_bus_message_get_member(message));
	int granted = dio_bus_authorise(viewd->bus, message,
					action == DIO_ACTION_SHUTDOWN ? ACTION_POWER : ACTION,
					on_action, context, error);
	struct dio_error why = {""};
	enum dio_status status;

	if (granted <= 0)
		return granted < 0 ? granted : 1;
	status = dio_viewd_ask(viewd, action, &why);
	if (status != DIO_OK)
		return dio_bus_set_error(error, status, &why);
	return sd_bus_reply_method_return(message, "");
}

static int on_save(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_viewd *viewd = context;
	int result = dio_bus_authorise(viewd->bus, message, ACTION, on_save, context, error);
	struct dio_error why = {""};
	enum dio_status status;
	const char *name;

	if (result <= 0)
		return result < 0 ? result : 1;
	result = sd_bus_message_read(message, "s", &name);
	if (result < 0)
		return result;
	status = dio_viewd_ask(viewd, DIO_ACTION_SAVE, &why);
	if (status != DIO_OK)
		return dio_bus_set_error(error, status, &why);
	/* The answer comes when it is saved. */
	dio_viewd_save(viewd, name, message);
	return 1;
}

static int on_turn(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_viewd *viewd = context;
	int result = dio_bus_authorise(viewd->bus, message, ACTION, on_turn, context, error);
	double azimuth, elevation, notches;
	struct dio_error why = {""};
	enum dio_status status;

	if (result <= 0)
		return result < 0 ? result : 1;
	result = sd_bus_message_read(message, "ddd", &azimuth, &elevation, &notches);
	if (result < 0)
		return result;
	status = dio_viewd_turn(viewd, azimuth, elevation, notches, &why);
	if (status != DIO_OK)
		return dio_bus_set_error(error, status, &why);
	return sd_bus_reply_method_return(message, "");
}

static int on_follow(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_viewd *viewd = context;
	int granted = dio_bus_authorise(viewd->bus, message, ACTION, on_follow, context, error);
	struct dio_error why = {""};
	enum dio_status status;

	if (granted <= 0)
		return granted < 0 ? granted : 1;
	status = dio_viewd_follow(viewd, &why);
	if (status != DIO_OK)
		return dio_bus_set_error(error, status, &why);
	return sd_bus_reply_method_return(message, "");
}

#define METHOD(name, handler) SD_BUS_METHOD(name, "", "", handler, SD_BUS_VTABLE_UNPRIVILEGED)

static const sd_bus_vtable VTABLE[] = {
	SD_BUS_VTABLE_START(0),
	METHOD("Calibrate", on_action),
	METHOD("CaptureView", on_action),
	METHOD("Reconstruct", on_action),
	METHOD("Play", on_action),
	METHOD("Cancel", on_action),
	METHOD("Shutdown", on_action),
	METHOD("Follow", on_follow),
	SD_BUS_METHOD_WITH_NAMES("Save", "s", SD_BUS_PARAM(name), "s", SD_BUS_PARAM(folder),
				 on_save, SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_METHOD_WITH_NAMES("Turn", "ddd",
				 SD_BUS_PARAM(azimuth_rad) SD_BUS_PARAM(elevation_rad)
					 SD_BUS_PARAM(notches),
				 "", , on_turn, SD_BUS_VTABLE_UNPRIVILEGED),
#define ENTRY(name, signature, field)                                                              \
	SD_BUS_PROPERTY(name, signature, on_get, offsetof(struct dio_viewd, status.field),         \
			SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
	PROPERTIES(ENTRY)
#undef ENTRY
		SD_BUS_VTABLE_END,
};

/* Texts are compared to their end, so that has to be all zero. */
static void set_text(char *to, size_t size, const char *from)
{
	char text[sizeof((struct dio_viewd_status *)0)->message] = "";

	snprintf(text, sizeof text, "%s", from);
	memcpy(to, text, size);
	to[size - 1] = '\0';
}

/* To a tenth: figures that only tremble are no news. */
static double rounded(double value)
{
	return round(value * 10) / 10;
}

static void take_figures(struct dio_viewd *viewd)
{
	struct dio_viewd_status *status = &viewd->status;

	dio_figures_get_latency(&viewd->figures, &status->latency_ms, &status->latency_p99_ms);
	status->fps = rounded(dio_figures_get_rate(&viewd->figures, dio_clock_ns()));
	status->latency_ms = rounded(status->latency_ms);
	status->latency_p99_ms = rounded(status->latency_p99_ms);
	status->render_ms = rounded(status->render_ms);
	status->track_ms = rounded((double)viewd->tracked.work_ns * 1e-6);
}

void dio_viewd_publish(struct dio_viewd *viewd)
{
	struct dio_viewd_status *status = &viewd->status;

	set_text(status->state, sizeof status->state, dio_viewd_state_name(viewd->machine.state));
	set_text(status->camera, sizeof status->camera,
		 dio_capture_state_name(viewd->tracked.camera));
	set_text(status->display, sizeof status->display,
		 viewd->display ? viewd->display_info.name : "");
	status->calibrated = viewd->calibrated;
	status->tracking = viewd->tracked.fresh && viewd->tracked.pose_known;
	status->gathered = viewd->gathered.count;
	status->coverage = viewd->gathered.coverage;
	status->views = viewd->views;
	status->views_min = viewd->profile->capture.views_min;
	status->views_max = viewd->profile->capture.views_max;
	memcpy(status->skipped, viewd->keyframes.verdicts, sizeof status->skipped);
	status->progress = atomic_load(&viewd->progress) / 1000.0;
	status->scene = viewd->scene_there;
	take_figures(viewd);
	for (size_t i = 0; i < sizeof FIELDS / sizeof *FIELDS; i++) {
		char *now = (char *)status + FIELDS[i].offset;
		char *said = (char *)&viewd->said + FIELDS[i].offset;

		if (memcmp(now, said, FIELDS[i].size) == 0)
			continue;
		memcpy(said, now, FIELDS[i].size);
		if (viewd->bus)
			dio_bus_mark_changed(viewd->bus, FIELDS[i].name);
	}
	if (viewd->bus)
		dio_bus_flush_changes(viewd->bus);
}

static enum dio_status connect_bus(struct dio_viewd *viewd, struct dio_error *error)
{
	struct dio_bus *bus = NULL;
	enum dio_status status = dio_bus_open(viewd->bus_address, &bus, error);

	if (status == DIO_OK)
		status = dio_bus_publish(bus, &DIO_BUS_VIEW, VTABLE, viewd, error);
	if (status == DIO_OK && sd_bus_attach_event(dio_bus_get_connection(bus), viewd->loop,
						    SD_EVENT_PRIORITY_NORMAL) < 0)
		status = dio_fail(error, DIO_IO, "bus: the event loop does not take it");
	if (status != DIO_OK) {
		dio_bus_close(bus);
		return status;
	}
	viewd->bus = bus;
	return DIO_OK;
}

enum dio_status dio_viewd_open_bus(struct dio_viewd *viewd, struct dio_error *error)
{
	struct dio_error why = {""};
	enum dio_status status;

	if (viewd->bus_address && strcmp(viewd->bus_address, "none") == 0)
		return DIO_OK;
	status = connect_bus(viewd, &why);
	/* Without a bus the buttons still work; a second daemon, though, must not run. */
	if (status == DIO_BUSY || status == DIO_REFUSED)
		return dio_fail(error, status, "%s", why.text);
	if (status != DIO_OK)
		dio_log_warn("%s; going on without it for now", why.text);
	return DIO_OK;
}

void dio_viewd_keep_bus(struct dio_viewd *viewd)
{
	struct dio_error ignored;

	if (viewd->bus_address && strcmp(viewd->bus_address, "none") == 0)
		return;
	if (viewd->bus && sd_bus_is_open(dio_bus_get_connection(viewd->bus)) <= 0) {
		dio_log_warn("the bus went away; looking for it again");
		dio_bus_close(viewd->bus);
		viewd->bus = NULL;
	}
	if (!viewd->bus && connect_bus(viewd, &ignored) == DIO_OK)
		dio_log_note("the bus is there");
}

void dio_viewd_power_off(struct dio_viewd *viewd)
{
	sd_bus_error fault = SD_BUS_ERROR_NULL;

	/* A box has its devices to itself on the system's bus; elsewhere only the daemon ends. */
	if (!viewd->bus || !dio_bus_is_system(viewd->bus))
		return;
	if (sd_bus_call_method(dio_bus_get_connection(viewd->bus), "org.freedesktop.login1",
			       "/org/freedesktop/login1", "org.freedesktop.login1.Manager",
			       "PowerOff", &fault, NULL, "b", 0) < 0)
		dio_log_error("cannot power off: %s",
			      fault.message ? fault.message : "no answer from logind");
	sd_bus_error_free(&fault);
}
