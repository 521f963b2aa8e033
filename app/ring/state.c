#include "ring/state.h"

const char *dio_capture_state_name(enum dio_capture_state state)
{
	switch (state) {
	case DIO_CAPTURE_STARTING:
		return "starting";
	case DIO_CAPTURE_STREAMING:
		return "streaming";
	case DIO_CAPTURE_NO_SIGNAL:
		return "no signal";
	case DIO_CAPTURE_STALLED:
		return "stalled";
	case DIO_CAPTURE_UNPLUGGED:
		return "unplugged";
	case DIO_CAPTURE_REFUSED:
		return "refused";
	case DIO_CAPTURE_ENDED:
		return "ended";
	case DIO_CAPTURE_ABSENT:
		return "absent";
	}
	return "unknown";
}
