/* What the display daemon was told: a board's profile, and the command line over it. */
#ifndef DIO_VIEWD_SETTINGS_H
#define DIO_VIEWD_SETTINGS_H

#include "profile/profile.h"

struct dio_viewd_settings {
	struct dio_profile profile;
	const char *bus; /* from argv, NULL: the default */
};

/** An exit code for a process that ends here, or DIO_VIEWD_RUN. A line is printed where needed. */
#define DIO_VIEWD_RUN (-1)
int dio_viewd_settings_read(struct dio_viewd_settings *settings, int argc, char **argv);

#endif
