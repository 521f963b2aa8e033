/* KMS in a build without libdrm: there is none. */
#include "backend.h"

enum dio_status dio_display_open_kms(const char *card, const struct dio_display_mode *mode,
				     const struct dio_display_options *options,
				     struct dio_display **display, struct dio_error *error)
{
	(void)card;
	(void)mode;
	(void)options;
	(void)display;
	return dio_fail(error, DIO_UNSUPPORTED,
			"display kms: this build has no libdrm; install libdrm-dev and build "
			"again, or choose window, file:PATH.mp4 or none");
}
