/* cmocka with the headers it needs in front. */
#ifndef CHECK_H
#define CHECK_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "dio/status.h"

/* The status, and a line that names the thing. */
#define assert_fails(call, expected, error, word)                                                  \
	do {                                                                                       \
		(error).text[0] = '\0';                                                            \
		assert_int_equal(call, expected);                                                  \
		if (!strstr((error).text, word))                                                   \
			fail_msg("'%s' does not say '%s'", (error).text, word);                    \
	} while (0)

#define assert_ok(call, error)                                                                     \
	do {                                                                                       \
		(error).text[0] = '\0';                                                            \
		if ((call) != DIO_OK)                                                              \
			fail_msg("%s", (error).text);                                              \
	} while (0)

#endif
