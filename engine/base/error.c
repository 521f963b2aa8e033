#include "base/error.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* Characters of a file's name that a message shows. */
#define NAME_ROOM 150

void dvsm_error_write(struct dvsm_error *error, const char *format, ...)
{
	if (!error)
		return;

	va_list arguments;
	va_start(arguments, format);
	vsnprintf(error->text, sizeof(error->text), format, arguments);
	va_end(arguments);
	for (char *c = error->text; *c; c++) {
		if ((unsigned char)*c < ' ' || *c == 0x7f)
			*c = '?';
	}
}

const char *dvsm_name_tail(const char *name)
{
	size_t length = strlen(name);
	return length > NAME_ROOM ? name + length - NAME_ROOM : name;
}

const char *dvsm_status_text(enum dvsm_status status)
{
	switch (status) {
	case DVSM_OK:
		return "ok";
	case DVSM_BAD_ARG:
		return "bad argument";
	case DVSM_BAD_FILE:
		return "bad file";
	case DVSM_IO:
		return "input or output error";
	case DVSM_NO_MEM:
		return "out of memory";
	case DVSM_MISMATCH:
		return "wrong model";
	case DVSM_UNSUPPORTED:
		return "unsupported";
	case DVSM_CANCELLED:
		return "cancelled";
	}
	return "unknown status";
}
