/* ctl: speak to the daemons over D-Bus. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bus/bus.h"
#include "commands.h"
#include "core/json_out.h"
#include "core/log.h"
#include "core/options.h"
#include "ctl_values.h"
#include "ctl_watch.h"
#include "report.h"

#define ANSWER_MS 60000u /* saving takes its time */

/* A method of a daemon, by the word that stands for it here. */
struct ctl_method {
	const char *word, *arguments, *help;
	const struct dio_bus_object *object;
	const char *method, *in; /* what it takes, as D-Bus types: "s" or "ddd" */
	const char *out;         /* "" or "s": a line to print; others are printed as JSON */
	bool may_be_left_out;    /* the only argument, a text: "" then */
};

static const struct ctl_method METHODS[] = {
	{"calibrate", "", "gather views of the board, then fit the camera; again: fit now",
	 &DIO_BUS_VIEW, "Calibrate", "", "", false},
	{"capture", "", "begin to gather views; again: keep one now", &DIO_BUS_VIEW, "CaptureView",
	 "", "", false},
	{"reconstruct", "", "make a scene of the views", &DIO_BUS_VIEW, "Reconstruct", "", "",
	 false},
	{"play", "", "show the scene along a path; again: follow the camera", &DIO_BUS_VIEW, "Play",
	 "", "", false},
	{"save", "[NAME]", "keep scene and views under a name", &DIO_BUS_VIEW, "Save", "s", "s",
	 true},
	{"cancel", "", "stop what is under way", &DIO_BUS_VIEW, "Cancel", "", "", false},
	{"turn", "AZIMUTH ELEVATION NOTCHES", "turn the scene by hand, radians", &DIO_BUS_VIEW,
	 "Turn", "ddd", "", false},
	{"follow", "", "follow the camera again", &DIO_BUS_VIEW, "Follow", "", "", false},
	{"shutdown", "", "end the display daemon; on the system bus: power off", &DIO_BUS_VIEW,
	 "Shutdown", "", "", false},
	{"lock", "", "hold exposure, gain and white balance", &DIO_BUS_CAPTURE, "Lock", "", "",
	 false},
	{"unlock", "", "let the camera choose them again", &DIO_BUS_CAPTURE, "Unlock", "", "",
	 false},
	{"record", "[NAME]", "record what the camera sees", &DIO_BUS_CAPTURE, "StartRecording", "s",
	 "s", true},
	{"stop-record", "", "end the recording", &DIO_BUS_CAPTURE, "StopRecording", "", "stt",
	 false},
	{"readers", "", "who reads the camera's frames", &DIO_BUS_CAPTURE, "ListReaders", "",
	 "a(sut)", false},
};

#define METHOD_COUNT (sizeof METHODS / sizeof *METHODS)

struct ctl_job {
	const char *bus;
	bool json;
	double timeout_s;
	const char *word;
	char **arguments; /* behind the word */
	uint32_t count;
};

static enum dio_status wrong_arguments(const struct ctl_job *job, const struct ctl_method *method,
				       struct dio_error *error)
{
	return dio_fail(error, DIO_BAD_ARG, "%s takes %s", job->word,
			*method->arguments ? method->arguments : "no argument");
}

static enum dio_status print_reply(const struct ctl_job *job, const struct ctl_method *method,
				   sd_bus_message *reply, struct dio_error *error)
{
	const char *text;
	cJSON *value;

	if (!*method->out)
		return DIO_OK;
	if (!job->json && method->out[0] == 's') {
		if (sd_bus_message_read_basic(reply, 's', &text) <= 0)
			return dio_fail(error, DIO_IO, "%s: an answer of another version",
					method->object->daemon);
		puts(text);
		return DIO_OK;
	}
	value = ctl_read_arguments(reply);
	if (!value)
		return dio_fail(error, DIO_IO, "%s: an answer of another version",
				method->object->daemon);
	return dio_json_print(value, error);
}

static enum dio_status call(const struct ctl_job *job, const struct ctl_method *method,
			    struct dio_bus *bus, struct dio_error *error)
{
	uint32_t wanted = (uint32_t)strlen(method->in);
	sd_bus_message *reply = NULL;
	double numbers[3] = {0};
	enum dio_status status;
	char *end;

	if (job->count != wanted && !(method->may_be_left_out && job->count == 0))
		return wrong_arguments(job, method, error);
	if (wanted == 3) {
		for (int i = 0; i < 3; i++) {
			numbers[i] = strtod(job->arguments[i], &end);
			if (end == job->arguments[i] || *end)
				return wrong_arguments(job, method, error);
		}
		status = dio_bus_call(bus, method->object, method->method, ANSWER_MS, &reply, error,
				      "ddd", numbers[0], numbers[1], numbers[2]);
	} else if (wanted == 1) {
		status = dio_bus_call(bus, method->object, method->method, ANSWER_MS, &reply, error,
				      "s", job->count ? job->arguments[0] : "");
	} else {
		status = dio_bus_call(bus, method->object, method->method, ANSWER_MS, &reply, error,
				      "");
	}
	if (status == DIO_OK)
		status = print_reply(job, method, reply, error);
	sd_bus_message_unref(reply);
	return status;
}

static void print_daemon(const struct dio_bus_object *object, const cJSON *values)
{
	const cJSON *item;

	puts(object->daemon);
	cJSON_ArrayForEach(item, values)
	{
		char *text = ctl_value_text(item);

		printf("  %-16s %s\n", item->string, text ? text : "");
		cJSON_free(text);
	}
}

/* What both daemons say of themselves. One that does not run is said so, and is a failure. */
static enum dio_status show_status(const struct ctl_job *job, struct dio_bus *bus,
				   struct dio_error *error)
{
	const struct dio_bus_object *const OBJECTS[] = {&DIO_BUS_CAPTURE, &DIO_BUS_VIEW};
	cJSON *all = cJSON_CreateObject();
	enum dio_status status = DIO_OK;

	for (size_t i = 0; i < 2; i++) {
		cJSON *values = cJSON_AddObjectToObject(all, OBJECTS[i]->daemon);
		struct dio_error why = {""};
		sd_bus_message *reply = NULL;
		enum dio_status asked = dio_bus_get_properties(bus, OBJECTS[i], &reply, &why);

		if (asked == DIO_OK && ctl_read_properties(reply, values)) {
			if (!job->json)
				print_daemon(OBJECTS[i], values);
		} else if (status == DIO_OK) {
			status = dio_fail(error, asked, "%s", why.text);
		} else {
			dio_log_error("ctl: %s", why.text);
		}
		sd_bus_message_unref(reply);
	}
	if (!job->json) {
		cJSON_Delete(all);
		return status;
	}
	if (dio_json_print(all, status == DIO_OK ? error : NULL) != DIO_OK && status == DIO_OK)
		return DIO_IO;
	return status;
}

static enum dio_status run(const struct ctl_job *job, struct dio_bus *bus, struct dio_error *error)
{
	bool waits = strcmp(job->word, "wait") == 0;

	if (strcmp(job->word, "status") == 0)
		return show_status(job, bus, error);
	if (strcmp(job->word, "watch") == 0 || waits) {
		if (job->count != (waits ? 1 : 0))
			return dio_fail(error, DIO_BAD_ARG,
					waits ? "wait takes PROPERTY=VALUE"
					      : "watch takes no argument");
		return ctl_watch(bus, waits ? job->arguments[0] : NULL, job->timeout_s, job->json,
				 error);
	}
	for (size_t i = 0; i < METHOD_COUNT; i++)
		if (strcmp(job->word, METHODS[i].word) == 0)
			return call(job, &METHODS[i], bus, error);
	return dio_fail(error, DIO_BAD_ARG, "%s: no such word; see diorama ctl --help", job->word);
}

/* The list of words for --help. */
static void list_words(char *text, size_t size)
{
	size_t used = (size_t)snprintf(text, size,
				       "words:\n"
				       "  %-34s%s\n  %-34s%s\n  %-34s%s\n",
				       "status", "all that both daemons say of themselves", "watch",
				       "print what changes, until interrupted",
				       "wait PROPERTY=VALUE", "wait until a property has a value");

	for (size_t i = 0; i < METHOD_COUNT && used < size; i++) {
		char call_text[64];

		snprintf(call_text, sizeof call_text, "%s %s", METHODS[i].word,
			 METHODS[i].arguments);
		used += (size_t)snprintf(text + used, size - used, "  %-34s%s\n", call_text,
					 METHODS[i].help);
	}
	if (used < size)
		snprintf(text + used, size - used,
			 "\nWithout --bus the environment variable DIORAMA_BUS names the bus, else "
			 "it is the system's.");
}

#define ARGUMENTS_MAX 16

/* Put "--" before the first argument that is a number below zero, which is no option. */
static int part_numbers(int argc, char **argv, char **parted)
{
	static char dashes[] = "--";
	int count = 0;
	bool is_parted = false;

	for (int i = 0; i < argc && count < ARGUMENTS_MAX; i++) {
		is_parted = is_parted || strcmp(argv[i], "--") == 0;
		if (!is_parted && argv[i][0] == '-' && strchr(".0123456789", argv[i][1]) &&
		    argv[i][1]) {
			parted[count++] = dashes;
			is_parted = true;
		}
		parted[count++] = argv[i];
	}
	return count;
}

int dio_command_ctl(int argc, char **argv)
{
	struct ctl_job job = {.timeout_s = 60};
	char words[4096];
	const struct dio_option options[] = {
		{"bus", DIO_OPTION_TEXT, "ADDRESS", "system, user, or a D-Bus address", &job.bus, 0,
		 0, false},
		{"timeout", DIO_OPTION_REAL, "S", "longest wait of `wait`, seconds (default: 60)",
		 &job.timeout_s, 0, 86400, false},
		{"json", DIO_OPTION_FLAG, NULL, "print as JSON", &job.json, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "ctl",
		.summary = "speak to the daemons over D-Bus",
		.arguments = "WORD [argument ...]",
		.details = words,
		.min_arguments = 1,
		.max_arguments = 4,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	struct dio_bus *bus = NULL;
	enum dio_options_result result;
	enum dio_status status;
	char **arguments, *parted[ARGUMENTS_MAX + 2] = {NULL};
	uint32_t count;

	list_words(words, sizeof words);
	argc = part_numbers(argc, argv, parted);
	result = dio_options_parse(&usage, argc, parted, &arguments, &count);
	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	job.word = arguments[0];
	job.arguments = arguments + 1;
	job.count = count - 1;
	status = dio_bus_open(job.bus, &bus, &error);
	if (status == DIO_OK)
		status = run(&job, bus, &error);
	dio_bus_close(bus);
	return status == DIO_OK ? DIO_EXIT_OK : dio_report_failure(usage.command, &error);
}
