/* A profile against the machine it is to run on. */
#ifndef DIO_APP_PROFILE_CHECK_H
#define DIO_APP_PROFILE_CHECK_H

#include "profile/profile.h"

/**
 * Add what is wrong beyond the file's own form: words a driver cannot read and, with `look`,
 * devices, lines and files that are not there. Nothing is opened for use or changed.
 *
 * report  as dio_profile_read() filled it; its places give the faults their lines
 */
void dio_profile_check(const struct dio_profile *profile, bool look,
		       struct dio_profile_report *report);

#endif
