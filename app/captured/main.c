/* diorama-captured: the capture daemon. It owns the camera, and nothing else. */
#include "captured/daemon.h"
#include "captured/settings.h"
#include "core/log.h"

int main(int argc, char **argv)
{
	struct dio_captured_settings settings;
	struct dio_error error;

	dio_log_set_program("diorama-captured");
	switch (dio_captured_settings_read(&settings, argc, argv)) {
	case DIO_SETTINGS_RUN:
		break;
	case DIO_SETTINGS_HELP:
		return 0;
	case DIO_SETTINGS_WRONG:
		return 2;
	case DIO_SETTINGS_FAILED:
		return 1;
	}
	if (dio_captured_run(&settings, &error) == DIO_OK)
		return 0;
	dio_log_error("%s", error.text);
	return 1;
}
