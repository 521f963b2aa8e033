#include "talk.h"

#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static int64_t now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

_Noreturn void talk_fail(const char *text)
{
	fprintf(stderr, "%s: %s\n", program_invocation_short_name, text);
	exit(1);
}

/* NumPy format 1.0, one row of numbers. */
static void write_numbers(const char *path, const struct talk *talk)
{
	FILE *file = fopen(path, "wb");
	char dictionary[118];

	if (!file)
		talk_fail("the output cannot be made");
	snprintf(dictionary, sizeof dictionary,
		 "{'descr': '<f4', 'fortran_order': False, 'shape': (%zu,), }", talk->count);
	fwrite("\x93NUMPY\x01\x00\x76\x00", 1, 10, file);
	fprintf(file, "%-117s\n", dictionary);
	fwrite(talk->numbers, sizeof *talk->numbers, talk->count, file);
	if (ferror(file) || fclose(file) != 0)
		talk_fail("the output cannot be written");
}

void talk_serve(const char *about, const struct talk *talk)
{
	char line[4096];

	puts(about);
	fflush(stdout);
	while (fgets(line, sizeof line, stdin)) {
		const int64_t start_ns = now_ns();

		line[strcspn(line, "\n")] = '\0';
		if (strncmp(line, "output ", 7) == 0) {
			write_numbers(line + 7, talk);
			puts("done");
		} else {
			(strcmp(line, "render") == 0 ? talk->render
						     : talk->reconstruct)(talk->context);
			printf("%lld\n", (long long)(now_ns() - start_ns));
		}
		fflush(stdout);
	}
}
