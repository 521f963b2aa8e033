#include "captured/settings.h"

#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/log.h"
#include "profile/profile.h"

/* In the order of --help. */
enum {
	OPTION_PROFILE = 1000,
	OPTION_CAMERA,
	OPTION_SIZE,
	OPTION_FPS,
	OPTION_HOLD,
	OPTION_SOCKET,
	OPTION_STATE,
	OPTION_BUS,
	OPTION_HELP,
	OPTION_VERSION
};

static const struct option OPTIONS[] = {
	{"profile", required_argument, NULL, OPTION_PROFILE},
	{"camera", required_argument, NULL, OPTION_CAMERA},
	{"size", required_argument, NULL, OPTION_SIZE},
	{"fps", required_argument, NULL, OPTION_FPS},
	{"hold", required_argument, NULL, OPTION_HOLD},
	{"socket", required_argument, NULL, OPTION_SOCKET},
	{"state", required_argument, NULL, OPTION_STATE},
	{"bus", required_argument, NULL, OPTION_BUS},
	{"help", no_argument, NULL, OPTION_HELP},
	{"version", no_argument, NULL, OPTION_VERSION},
	{0},
};

static void print_help(void)
{
	puts("diorama-captured: own the camera, share its newest frames\n\n"
	     "usage: diorama-captured [options]\n\noptions:\n"
	     "  --profile FILE   board profile; " DIO_PROFILE_BOARD " when that exists\n"
	     "  --camera SPEC    v4l2:/dev/video0, libcamera:0, sim:table?seed=1, replay:FOLDER\n"
	     "  --size WxH       picture size wished; 0x0: the device's choice\n"
	     "  --fps RATE       frames a second wished; 0: the device's choice\n"
	     "  --hold yes|no    settle, then hold exposure, gain and white balance from the "
	     "start\n"
	     "  --socket PATH    where readers find the frames\n"
	     "  --state FOLDER   recordings go to FOLDER/recordings\n"
	     "  --bus ADDRESS    system, user, a D-Bus address, or none\n"
	     "  --version        print the version\n"
	     "  --help           this text\n\n"
	     "Options override the profile. Exit status: 0 ended by a signal, 1 failed, 2 wrong "
	     "usage.");
}

static bool set_text(char *to, size_t size, const char *from)
{
	if (snprintf(to, size, "%s", from) < (int)size)
		return true;
	dio_log_error("%s: too long; at most %zu letters", from, size - 1);
	return false;
}

static bool wrong(const char *option, const char *value, const char *wanted)
{
	dio_log_error("--%s %s: %s is wanted", option, value, wanted);
	return false;
}

static bool set_size(struct dio_captured_settings *settings, const char *value)
{
	unsigned width, height;
	int end = 0;

	if (sscanf(value, "%5ux%5u%n", &width, &height, &end) != 2 || value[end] || width > 16384 ||
	    height > 16384)
		return wrong("size", value, "a size such as 640x480");
	settings->options.width = width;
	settings->options.height = height;
	return true;
}

static bool set_rate(struct dio_captured_settings *settings, const char *value)
{
	char *end;
	double rate = strtod(value, &end);

	if (end == value || *end || !isfinite(rate) || rate < 0 || rate > 1000)
		return wrong("fps", value, "a number from 0 to 1000");
	settings->options.frames_per_second = rate;
	return true;
}

static bool set_hold(struct dio_captured_settings *settings, const char *value)
{
	if (strcmp(value, "yes") != 0 && strcmp(value, "no") != 0)
		return wrong("hold", value, "yes or no");
	settings->wish.hold = value[0] == 'y';
	return true;
}

static bool set_state_folder(struct dio_captured_settings *settings, const char *folder)
{
	if (snprintf(settings->recordings, sizeof(settings->recordings), "%s/recordings", folder) <
	    (int)sizeof(settings->recordings))
		return true;
	dio_log_error("%s: too long for a folder", folder);
	return false;
}

static bool set_option(struct dio_captured_settings *settings, int code, const char *value)
{
	switch (code) {
	case OPTION_CAMERA:
		return set_text(settings->camera, sizeof(settings->camera), value);
	case OPTION_SIZE:
		return set_size(settings, value);
	case OPTION_FPS:
		return set_rate(settings, value);
	case OPTION_HOLD:
		return set_hold(settings, value);
	case OPTION_SOCKET:
		return set_text(settings->socket, sizeof(settings->socket), value);
	case OPTION_STATE:
		return set_state_folder(settings, value);
	case OPTION_BUS:
		return set_text(settings->bus, sizeof(settings->bus), value);
	default:
		return true;
	}
}

static enum dio_camera_flicker flicker_of(enum dio_profile_flicker flicker)
{
	switch (flicker) {
	case DIO_FLICKER_AUTO:
		return DIO_CAMERA_FLICKER_AUTO;
	case DIO_FLICKER_OFF:
		return DIO_CAMERA_FLICKER_OFF;
	case DIO_FLICKER_50HZ:
		return DIO_CAMERA_FLICKER_50HZ;
	case DIO_FLICKER_60HZ:
		return DIO_CAMERA_FLICKER_60HZ;
	}
	return DIO_CAMERA_FLICKER_KEEP;
}

static bool apply_profile(struct dio_captured_settings *settings, const struct dio_profile *profile)
{
	const struct dio_profile_camera *camera = &profile->camera;
	char socket[DIO_PROFILE_TEXT_MAX + 8];

	settings->options.width = camera->width;
	settings->options.height = camera->height;
	settings->options.frames_per_second = camera->frames_per_second;
	settings->wish = (struct dio_camera_wish){.hold = camera->lock,
						  .exposure_us = camera->exposure_us,
						  .gain = camera->gain,
						  .flicker = flicker_of(camera->flicker)};
	settings->settle_ms = camera->settle_ms;
	settings->stalled_ms = profile->capture.stalled_ms;
	settings->ring_slots = profile->capture.ring_slots;
	settings->reserve_mib = profile->capture.reserve_mib;
	snprintf(socket, sizeof(socket), "%s/frames", profile->paths.runtime);
	return set_text(settings->camera, sizeof(settings->camera), camera->source) &&
	       set_text(settings->socket, sizeof(settings->socket), socket) &&
	       set_state_folder(settings, profile->paths.state);
}

static enum dio_settings_result read_profile(struct dio_captured_settings *settings,
					     const char *path)
{
	struct dio_profile *profile = malloc(sizeof(*profile));
	enum dio_settings_result result = DIO_SETTINGS_FAILED;
	struct dio_error error;

	if (!profile) {
		dio_log_error("no memory for the profile");
		return result;
	}
	if (dio_profile_load(path, profile, &error) != DIO_OK)
		dio_log_error("%s", error.text);
	else if (apply_profile(settings, profile))
		result = DIO_SETTINGS_RUN;
	free(profile);
	return result;
}

/* One walk over argv: with `settings` NULL only the profile's name is looked for. */
static enum dio_settings_result walk(struct dio_captured_settings *settings, int argc, char **argv,
				     const char **profile)
{
	int code;

	optind = 0; /* glibc: start afresh */
	while ((code = getopt_long(argc, argv, ":h", OPTIONS, NULL)) != -1) {
		if (code == 'h' || code == OPTION_HELP) {
			print_help();
			return DIO_SETTINGS_HELP;
		}
		if (code == OPTION_VERSION) {
			puts("diorama-captured " DIO_VERSION);
			return DIO_SETTINGS_HELP;
		}
		if (code == ':' || code == '?') {
			dio_log_error("%s: %s; see diorama-captured --help", argv[optind - 1],
				      code == ':' ? "a value is missing"
						  : "no such option, or one that takes no value");
			return DIO_SETTINGS_WRONG;
		}
		if (code == OPTION_PROFILE)
			*profile = optarg;
		else if (settings && !set_option(settings, code, optarg))
			return DIO_SETTINGS_WRONG;
	}
	if (optind == argc)
		return DIO_SETTINGS_RUN;
	dio_log_error("%s: no argument is wanted; see diorama-captured --help", argv[optind]);
	return DIO_SETTINGS_WRONG;
}

/* A device's driver bounds its queue, so every frame is taken in order; a camera made of files or
 * of arithmetic would fall behind for ever, and moves on to the newest instead. */
static bool is_device(const char *camera)
{
	return strncmp(camera, "v4l2:", 5) == 0 || strncmp(camera, "/dev/", 5) == 0 ||
	       strncmp(camera, "libcamera:", 10) == 0;
}

enum dio_settings_result dio_captured_settings_read(struct dio_captured_settings *settings,
						    int argc, char **argv)
{
	const char *profile = NULL;
	enum dio_settings_result result = walk(NULL, argc, argv, &profile);

	*settings = (struct dio_captured_settings){0};
	if (result == DIO_SETTINGS_RUN)
		result = read_profile(settings, profile);
	if (result == DIO_SETTINGS_RUN)
		result = walk(settings, argc, argv, &profile);
	settings->options.every_frame = is_device(settings->camera);
	return result;
}
