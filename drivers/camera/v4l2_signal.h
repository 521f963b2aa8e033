/* Whether a V4L2 input has a signal, and of what size: video receivers such as HDMI inputs. */
#ifndef DIO_CAMERA_V4L2_SIGNAL_H
#define DIO_CAMERA_V4L2_SIGNAL_H

#include "v4l2_format.h"

/** Take over the timings of the signal that is there, and ask to be told of changes; a device that
 * knows neither (a webcam) is left as it is. `events`: whether poll() may say POLLPRI. */
void dio_v4l2_signal_adopt(const struct dio_v4l2_device *device, bool *events);

/** DIO_NO_SIGNAL: the driver says that the present input has none. Else DIO_OK. */
enum dio_status dio_v4l2_signal_check(const struct dio_v4l2_device *device,
				      struct dio_error *error);

/** Take the events that wait. true: the signal no longer is the one whose timings are in force. */
bool dio_v4l2_signal_has_changed(const struct dio_v4l2_device *device);

#endif
