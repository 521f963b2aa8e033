/* What device tests share: the leave to run, and small files of the kernel's. */
#ifndef TESTS_DEVICE_H
#define TESTS_DEVICE_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/** Without leave or the device, main() returns this: skipped. */
#define DEVICE_SKIPPED 77

static inline bool device_tests_may_run(const char *what)
{
	const char *leave = getenv("DIO_DEVICE_TESTS");

	if (leave && strcmp(leave, "1") == 0)
		return true;
	printf("skipped: %s is used only with DIO_DEVICE_TESTS=1\n", what);
	return false;
}

/** Write a word to a file of /sys; false when it is refused. */
static inline bool device_write(const char *path, const char *word)
{
	FILE *file = fopen(path, "w");
	bool written = file && fputs(word, file) >= 0;

	if (file && fclose(file) != 0)
		written = false;
	return written;
}

/** The first line of a file, without its end; "" when there is none. */
static inline void device_read(const char *path, char *text, size_t size)
{
	FILE *file = fopen(path, "r");

	text[0] = '\0';
	if (file && fgets(text, (int)size, file))
		text[strcspn(text, "\n")] = '\0';
	if (file)
		fclose(file);
}

#endif
