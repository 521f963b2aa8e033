#include "core/log.h"

#include <stdarg.h>
#include <stdio.h>

static const char *program = "diorama";

void dio_log_set_program(const char *name)
{
	program = name;
}

/* One call of vfprintf a line keeps lines of several threads whole. */
__attribute__((format(printf, 2, 0))) static void print_line(const char *kind, const char *format,
							     va_list arguments)
{
	char text[1024];

	vsnprintf(text, sizeof text, format, arguments);
	fprintf(stderr, "%s: %s%s\n", program, kind, text);
}

void dio_log_error(const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	print_line("", format, arguments);
	va_end(arguments);
}

void dio_log_warn(const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	print_line("warning: ", format, arguments);
	va_end(arguments);
}

void dio_log_note(const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	print_line("", format, arguments);
	va_end(arguments);
}
