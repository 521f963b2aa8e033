#include "dio/status.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>

const char *dio_status_text(enum dio_status status)
{
	switch (status) {
	case DIO_OK:
		return "success";
	case DIO_AGAIN:
		return "nothing yet";
	case DIO_END:
		return "end of data";
	case DIO_NO_SIGNAL:
		return "no signal";
	case DIO_BAD_ARG:
		return "bad argument";
	case DIO_BAD_FILE:
		return "bad file";
	case DIO_NOT_FOUND:
		return "not found";
	case DIO_BUSY:
		return "device busy";
	case DIO_GONE:
		return "device gone";
	case DIO_IO:
		return "input/output error";
	case DIO_NO_SPACE:
		return "disk full";
	case DIO_NO_MEM:
		return "out of memory";
	case DIO_UNSUPPORTED:
		return "not supported";
	case DIO_REFUSED:
		return "refused";
	}
	return "unknown status";
}

/* In brackets: the header may put a macro of this name before the function. */
enum dio_status(dio_fail)(struct dio_error *error, enum dio_status status, const char *format, ...)
{
	if (error) {
		va_list arguments;

		va_start(arguments, format);
		/* clang-tidy 14 forgets va_start() when it is given several files at once. */
		/* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized) */
		vsnprintf(error->text, sizeof(error->text), format, arguments);
		va_end(arguments);
		/* One line, whatever a file has put into its names. */
		for (char *at = error->text; *at; at++)
			if ((unsigned char)*at < ' ' || *at == 0x7f)
				*at = '?';
	}
	return status;
}

enum dio_status dio_status_from_errno(int errno_value)
{
	switch (errno_value) {
	case 0:
		return DIO_OK;
	case EAGAIN:
	case ETIMEDOUT:
		return DIO_AGAIN;
	case ENOENT:
	case ENOTDIR:
		return DIO_NOT_FOUND;
	case EBUSY:
		return DIO_BUSY;
	case ENODEV:
	case ENXIO:
		return DIO_GONE;
	case ENOSPC:
	case EDQUOT:
		return DIO_NO_SPACE;
	case ENOMEM:
	case EOVERFLOW:
		return DIO_NO_MEM;
	case EINVAL:
	case ENAMETOOLONG:
		return DIO_BAD_ARG;
	case ENOTTY:
	case ENOSYS:
	case EOPNOTSUPP:
		return DIO_UNSUPPORTED;
	default:
		return DIO_IO;
	}
}
