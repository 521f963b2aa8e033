#include "captured/control.h"

#include <inttypes.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bus/bus.h"
#include "core/log.h"
#include "dio/clock.h"

#define ACTION    "org.diorama.capture.control"
#define NS_PER_MS 1000000ull
/* Pauses between tries to get onto the bus: short at first, since the bus may still hold the name
 * for a daemon that was killed just now. */
#define RETRY_MIN_NS (100 * NS_PER_MS)
#define RETRY_MAX_NS (2000 * NS_PER_MS)
#define TEXT_SIZE    512

/* The properties' values. Texts are zero to their end. */
struct shown {
	char state[TEXT_SIZE], state_text[TEXT_SIZE], camera[TEXT_SIZE], format[TEXT_SIZE];
	char hold[TEXT_SIZE], held[TEXT_SIZE], offered[TEXT_SIZE];
	char recording[TEXT_SIZE], recording_text[TEXT_SIZE];
	uint32_t width, height, exposure_us, white_balance, readers;
	double nominal_rate, rate, gain, drop_share;
	uint64_t frames, drops, lost, drained, broken, missed, recoveries;
	uint64_t recorded, recording_drops, memory_bytes;
};

struct dio_control {
	char address[256];
	struct dio_control_parts parts;
	struct dio_bus *bus;         /* NULL: away */
	uint64_t retry_ns, pause_ns; /* the next try, and the pause after it */
	struct shown now, told;      /* as they are, and as they were last signalled */
};

/* Name, signature, field, and whether it runs all the time and is told once a second only. */
#define PROPERTIES(X)                                                                              \
	X("State", "s", state, false)                                                              \
	X("StateText", "s", state_text, false)                                                     \
	X("Camera", "s", camera, false)                                                            \
	X("Format", "s", format, false)                                                            \
	X("Width", "u", width, false)                                                              \
	X("Height", "u", height, false)                                                            \
	X("NominalRate", "d", nominal_rate, false)                                                 \
	X("Rate", "d", rate, true)                                                                 \
	X("Frames", "t", frames, true)                                                             \
	X("Drops", "t", drops, true)                                                               \
	X("DropShare", "d", drop_share, true)                                                      \
	X("Lost", "t", lost, true)                                                                 \
	X("Drained", "t", drained, true)                                                           \
	X("Broken", "t", broken, true)                                                             \
	X("Recoveries", "t", recoveries, false)                                                    \
	X("Hold", "s", hold, false)                                                                \
	X("Held", "s", held, false)                                                                \
	X("HoldOffered", "s", offered, false)                                                      \
	X("Exposure", "u", exposure_us, false)                                                     \
	X("Gain", "d", gain, false)                                                                \
	X("WhiteBalance", "u", white_balance, false)                                               \
	X("Readers", "u", readers, false)                                                          \
	X("MissedWakeUps", "t", missed, true)                                                      \
	X("MemoryBytes", "t", memory_bytes, false)                                                 \
	X("Recording", "s", recording, false)                                                      \
	X("RecordingText", "s", recording_text, false)                                             \
	X("Recorded", "t", recorded, true)                                                         \
	X("RecordingDrops", "t", recording_drops, true)

static const struct {
	const char *name;
	size_t offset, size;
	bool runs;
} CHANGES[] = {
#define CHANGE(name, signature, field, runs)                                                       \
	{(name), offsetof(struct shown, field), sizeof(((struct shown *)NULL)->field), runs},
	PROPERTIES(CHANGE)
#undef CHANGE
};

static int get_property(sd_bus *bus, const char *path, const char *interface, const char *property,
			sd_bus_message *reply, void *value, sd_bus_error *error)
{
	char signature = 's';

	(void)bus;
	(void)path;
	(void)interface;
	(void)error;
#define SIGNATURE(name, letter, field, runs)                                                       \
	if (strcmp(property, name) == 0)                                                           \
		signature = (letter)[0];
	PROPERTIES(SIGNATURE)
#undef SIGNATURE
	return sd_bus_message_append_basic(reply, signature, value);
}

static int authorise(struct dio_control *control, sd_bus_message *message,
		     sd_bus_message_handler_t handler, sd_bus_error *error)
{
	return dio_bus_authorise(control->bus, message, ACTION, handler, control, error);
}

static int on_hold(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_control *control = context;
	int granted = authorise(control, message, on_hold, error);

	if (granted <= 0)
		return granted < 0 ? granted : 1;
	dio_camera_thread_hold(control->parts.camera,
			       strcmp(sd_bus_message_get_member(message), "Lock") == 0);
	return sd_bus_reply_method_return(message, "");
}

static enum dio_status start_recording(struct dio_control *control, const char *name,
				       struct dio_error *error)
{
	struct dio_capture_status status;

	dio_camera_thread_get_status(control->parts.camera, &status);
	if (status.state != DIO_CAPTURE_STREAMING)
		return dio_fail(error, DIO_NO_SIGNAL, "camera %s: %s; nothing can be recorded",
				dio_capture_state_name(status.state),
				status.text[0] ? status.text : "no frames yet");
	return dio_recording_start(control->parts.recording, name, &status.camera, error);
}

static int on_start_recording(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_control *control = context;
	struct dio_recording_status recording;
	struct dio_error why;
	enum dio_status status;
	const char *name;
	int result = authorise(control, message, on_start_recording, error);

	if (result <= 0)
		return result < 0 ? result : 1;
	result = sd_bus_message_read(message, "s", &name);
	if (result < 0)
		return result;
	status = start_recording(control, name, &why);
	if (status != DIO_OK)
		return dio_bus_set_error(error, status, &why);
	dio_recording_get_status(control->parts.recording, &recording);
	dio_control_update(control, true);
	return sd_bus_reply_method_return(message, "s", recording.path);
}

static int on_stop_recording(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_control *control = context;
	struct dio_recording_status recording;
	struct dio_error why;
	enum dio_status status;
	int granted = authorise(control, message, on_stop_recording, error);

	if (granted <= 0)
		return granted < 0 ? granted : 1;
	status = dio_recording_stop(control->parts.recording, &why);
	if (status != DIO_OK)
		return dio_bus_set_error(error, status, &why);
	dio_recording_get_status(control->parts.recording, &recording);
	dio_control_update(control, true);
	return sd_bus_reply_method_return(message, "stt", recording.path, recording.frames,
					  recording.dropped);
}

/* Who reads: name, process, and wake-ups that could not be sent to it. */
static int on_list_readers(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_control *control = context;
	struct dio_ring_reader readers[32];
	sd_bus_message *reply = NULL;
	size_t n = dio_ring_server_list_readers(control->parts.ring, readers, 32);
	int result = sd_bus_message_new_method_return(message, &reply);

	(void)error;
	if (result >= 0)
		result = sd_bus_message_open_container(reply, 'a', "(sut)");
	for (size_t i = 0; result >= 0 && i < n; i++)
		result = sd_bus_message_append(reply, "(sut)", readers[i].name,
					       (uint32_t)readers[i].pid, readers[i].missed);
	if (result >= 0)
		result = sd_bus_message_close_container(reply);
	if (result >= 0)
		result = sd_bus_send(NULL, reply, NULL);
	sd_bus_message_unref(reply);
	return result;
}

static const sd_bus_vtable VTABLE[] = {
	SD_BUS_VTABLE_START(0),
	SD_BUS_METHOD("Lock", "", "", on_hold, SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_METHOD("Unlock", "", "", on_hold, SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_METHOD_WITH_NAMES("StartRecording", "s", SD_BUS_PARAM(name), "s", SD_BUS_PARAM(path),
				 on_start_recording, SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_METHOD_WITH_NAMES("StopRecording", "", , "stt",
				 SD_BUS_PARAM(path) SD_BUS_PARAM(frames) SD_BUS_PARAM(dropped),
				 on_stop_recording, SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_METHOD_WITH_NAMES("ListReaders", "", , "a(sut)", SD_BUS_PARAM(readers),
				 on_list_readers, SD_BUS_VTABLE_UNPRIVILEGED),
#define ENTRY(name, signature, field, runs)                                                        \
	SD_BUS_PROPERTY(name, signature, get_property, offsetof(struct dio_control, now.field),    \
			SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
	PROPERTIES(ENTRY)
#undef ENTRY
		SD_BUS_VTABLE_END,
};

static void list_locks(char *text, size_t size, uint32_t locks)
{
	static const struct {
		uint32_t lock;
		const char *name;
	} names[] = {
		{DIO_LOCK_EXPOSURE, "exposure"},
		{DIO_LOCK_GAIN, "gain"},
		{DIO_LOCK_WHITE_BALANCE, "white-balance"},
		{DIO_LOCK_FOCUS, "focus"},
	};

	for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
		size_t n = strlen(text);

		if (locks & names[i].lock)
			snprintf(text + n, size - n, "%s%s", n ? " " : "", names[i].name);
	}
}

static void show_camera(const struct dio_capture_status *status, struct shown *shown)
{
	const struct dio_camera_counters *counters = &status->counters;
	const struct dio_frame_metadata *metadata = &status->controls.metadata;
	const bool known = status->camera.name[0] != '\0';

	snprintf(shown->state, sizeof(shown->state), "%s", dio_capture_state_name(status->state));
	snprintf(shown->state_text, sizeof(shown->state_text), "%s", status->text);
	snprintf(shown->camera, sizeof(shown->camera), "%s", status->camera.name);
	snprintf(shown->format, sizeof(shown->format), "%s",
		 known ? dio_pixel_format_name(status->camera.format) : "");
	shown->width = status->camera.width;
	shown->height = status->camera.height;
	shown->nominal_rate = status->camera.frames_per_second;
	shown->rate = status->rate;
	shown->lost = counters->lost;
	shown->drained = counters->drained;
	shown->broken = counters->broken;
	shown->drops = counters->lost + counters->drained + counters->broken;
	shown->recoveries = status->recoveries;
	snprintf(shown->hold, sizeof(shown->hold), "%s", dio_hold_state_name(status->hold));
	list_locks(shown->held, sizeof(shown->held), metadata->locked);
	list_locks(shown->offered, sizeof(shown->offered), status->controls.offered);
	shown->exposure_us = metadata->exposure_us;
	shown->white_balance = metadata->white_balance_k;
	shown->gain = (double)metadata->gain;
}

static void show(const struct dio_control *control, struct shown *shown)
{
	struct dio_capture_status status;
	struct dio_recording_status recording;
	struct dio_ring_counters ring;

	memset(shown, 0, sizeof(*shown));
	dio_camera_thread_get_status(control->parts.camera, &status);
	dio_recording_get_status(control->parts.recording, &recording);
	dio_ring_server_get_counters(control->parts.ring, &ring);
	show_camera(&status, shown);
	shown->frames = ring.published;
	if (shown->frames + shown->drops > 0)
		shown->drop_share = (double)shown->drops / (double)(shown->frames + shown->drops);
	shown->readers = ring.readers;
	shown->missed = ring.missed;
	shown->memory_bytes = ring.memory_bytes;
	if (recording.active)
		snprintf(shown->recording, sizeof(shown->recording), "%s", recording.path);
	snprintf(shown->recording_text, sizeof(shown->recording_text), "%s", recording.text);
	shown->recorded = recording.frames;
	shown->recording_drops = recording.dropped;
}

void dio_control_update(struct dio_control *control, bool counters)
{
	show(control, &control->now);
	for (size_t i = 0; i < sizeof(CHANGES) / sizeof(CHANGES[0]); i++) {
		char *told = (char *)&control->told + CHANGES[i].offset;
		const char *now = (const char *)&control->now + CHANGES[i].offset;

		if ((CHANGES[i].runs && !counters) || memcmp(told, now, CHANGES[i].size) == 0)
			continue;
		memcpy(told, now, CHANGES[i].size);
		if (control->bus)
			dio_bus_mark_changed(control->bus, CHANGES[i].name);
	}
	if (control->bus)
		dio_bus_flush_changes(control->bus);
}

static void lose_bus(struct dio_control *control)
{
	dio_bus_close(control->bus);
	control->bus = NULL;
	control->retry_ns = dio_clock_ns() + control->pause_ns;
	control->pause_ns =
		control->pause_ns * 2 < RETRY_MAX_NS ? control->pause_ns * 2 : RETRY_MAX_NS;
}

static enum dio_status find_bus(struct dio_control *control, struct dio_error *error)
{
	const char *address = control->address[0] ? control->address : NULL;
	enum dio_status status = dio_bus_open(address, &control->bus, error);

	if (status == DIO_OK)
		status = dio_bus_publish(control->bus, &DIO_BUS_CAPTURE, VTABLE, control, error);
	if (status == DIO_OK)
		control->pause_ns = RETRY_MIN_NS;
	else
		lose_bus(control);
	return status;
}

static bool is_off(const struct dio_control *control)
{
	return strcmp(control->address, "none") == 0;
}

enum dio_status dio_control_create(const char *address, const struct dio_control_parts *parts,
				   struct dio_control **control, struct dio_error *error)
{
	struct dio_control *made = calloc(1, sizeof(*made));

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "no memory for the bus");
	snprintf(made->address, sizeof(made->address), "%s", address);
	made->parts = *parts;
	made->pause_ns = RETRY_MIN_NS;
	if (!is_off(made) && find_bus(made, error) != DIO_OK)
		dio_log_warn("%s; going on without it for now", error->text);
	*control = made;
	return DIO_OK;
}

void dio_control_destroy(struct dio_control *control)
{
	if (!control)
		return;
	dio_bus_close(control->bus);
	free(control);
}

void dio_control_prepare(const struct dio_control *control, struct pollfd *fd, int *timeout_ms)
{
	const uint64_t now = dio_clock_ns();

	*fd = (struct pollfd){.fd = -1};
	*timeout_ms = -1;
	if (control->bus)
		dio_bus_prepare(control->bus, fd, timeout_ms);
	else if (!is_off(control))
		*timeout_ms = control->retry_ns > now
				      ? (int)((control->retry_ns - now) / NS_PER_MS + 1)
				      : 0;
}

void dio_control_process(struct dio_control *control)
{
	struct dio_error error;

	if (control->bus) {
		show(control, &control->now);
		if (dio_bus_process(control->bus, &error) == DIO_GONE) {
			dio_log_warn("%s; looking for it again", error.text);
			lose_bus(control);
		}
	} else if (!is_off(control) && dio_clock_ns() >= control->retry_ns &&
		   find_bus(control, &error) == DIO_OK) {
		dio_log_note("on the bus");
	}
}
