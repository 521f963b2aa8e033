#include "viewd/settings.h"

#include <getopt.h>
#include <stdio.h>
#include <string.h>

#include "core/log.h"

static const struct option OPTIONS[] = {
	{"profile", required_argument, NULL, 'p'},
	{"display", required_argument, NULL, 'd'},
	{"state", required_argument, NULL, 's'},
	{"runtime", required_argument, NULL, 'r'},
	{"model", required_argument, NULL, 'm'},
	{"bus", required_argument, NULL, 'b'},
	{"version", no_argument, NULL, 'V'},
	{"help", no_argument, NULL, 'h'},
	{0},
};

static void print_help(void)
{
	puts("diorama-viewd: track, capture, reconstruct and show\n\n"
	     "usage: diorama-viewd [options]\n\noptions:\n"
	     "  --profile FILE     board profile; " DIO_PROFILE_BOARD " when that exists\n"
	     "  --display SPEC     kms, window, file:PATH.mp4 or none\n"
	     "  --state FOLDER     calibration, captures and scenes\n"
	     "  --runtime FOLDER   where the capture daemon's socket is\n"
	     "  --model FILE       weights, safetensors\n"
	     "  --bus ADDRESS      system, user, a D-Bus address, or none\n"
	     "  --version          print the version\n"
	     "  --help             this text\n\n"
	     "Options override the profile. `diorama ctl` speaks to a running daemon. Exit "
	     "status:\n"
	     "0 ended as asked, 1 failed, 2 wrong usage.");
}

/* Where an option's value goes; NULL: elsewhere. */
static char *place_of(struct dio_profile *profile, int code)
{
	switch (code) {
	case 'd':
		return profile->display.output;
	case 's':
		return profile->paths.state;
	case 'r':
		return profile->paths.runtime;
	case 'm':
		return profile->engine.model;
	default:
		return NULL;
	}
}

static int set_option(struct dio_viewd_settings *settings, int code, const char *value)
{
	char *place = place_of(&settings->profile, code);

	if (code == 'b')
		settings->bus = value;
	if (!place)
		return DIO_VIEWD_RUN;
	if (strlen(value) >= DIO_PROFILE_TEXT_MAX) {
		dio_log_error("%.40s...: at most %d letters", value, DIO_PROFILE_TEXT_MAX - 1);
		return 2;
	}
	memcpy(place, value, strlen(value) + 1);
	return DIO_VIEWD_RUN;
}

int dio_viewd_settings_read(struct dio_viewd_settings *settings, int argc, char **argv)
{
	const char *profile = NULL;
	struct dio_error why = {""};
	int code, result = DIO_VIEWD_RUN;

	settings->bus = NULL;
	/* The profile first, wherever it stands: the other options override it. */
	while ((code = getopt_long(argc, argv, "h", OPTIONS, NULL)) != -1) {
		if (code == 'h')
			print_help();
		else if (code == 'V')
			puts("diorama-viewd " DIO_VERSION);
		else if (code == 'p')
			profile = optarg;
		if (code == 'h' || code == 'V')
			return 0;
		if (code == '?')
			return 2;
	}
	if (optind < argc) {
		dio_log_error("%s: no argument is taken; see --help", argv[optind]);
		return 2;
	}
	if (dio_profile_load(profile, &settings->profile, &why) != DIO_OK) {
		dio_log_error("%s", why.text);
		return 1;
	}
	optind = 1;
	while (result == DIO_VIEWD_RUN &&
	       (code = getopt_long(argc, argv, "h", OPTIONS, NULL)) != -1)
		result = set_option(settings, code, optarg);
	return result;
}
