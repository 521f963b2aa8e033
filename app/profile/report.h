/* What is wrong with a profile, all of it, and where each key stands. */
#ifndef DIO_APP_PROFILE_REPORT_H
#define DIO_APP_PROFILE_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/status.h"

/** One fault; line 0: of the file as a whole. */
struct dio_profile_fault {
	uint32_t line;
	char text[384];
};

/** Where a key was given. */
struct dio_profile_place {
	char section[80], key[32];
	uint32_t line;
};

/** Zero-initialise; release with dio_profile_report_deinit(). */
struct dio_profile_report {
	struct dio_profile_fault *faults;
	size_t fault_count;
	struct dio_profile_place *places;
	size_t place_count;
	bool short_of_memory; /* not all could be kept */
};

void dio_profile_report_deinit(struct dio_profile_report *report);

__attribute__((format(printf, 3, 4))) void
dio_profile_report_fault(struct dio_profile_report *report, uint32_t line, const char *format, ...);

/** Note where a key stands. */
void dio_profile_report_place(struct dio_profile_report *report, const char *section,
			      const char *key, uint32_t line);

/** The line where a key stands (or, with key NULL, the section); 0 when it does not. */
uint32_t dio_profile_report_line(const struct dio_profile_report *report, const char *section,
				 const char *key);

/** Faults in the order of the file. */
void dio_profile_report_sort(struct dio_profile_report *report);

#endif
