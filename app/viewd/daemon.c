/* What every part of the daemon may call. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "core/log.h"
#include "dio/clock.h"
#include "viewd/viewd.h"

/* Who has not asked the page for a picture for so long has gone. */
#define WATCHED_NS UINT64_C(3000000000)

void dio_viewd_say(struct dio_viewd *viewd, bool alarm, const char *format, ...)
{
	char text[sizeof viewd->status.message] = ""; /* compared to its end */
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(text, sizeof text, format, arguments);
	va_end(arguments);
	if (strcmp(text, viewd->status.message) == 0 && viewd->status.alarm == alarm)
		return;
	memcpy(viewd->status.message, text, sizeof text);
	viewd->status.alarm = alarm;
	viewd->news = true;
	if (!*text)
		return;
	if (alarm)
		dio_log_error("%s", text);
	else
		dio_log_note("%s", text);
}

void dio_viewd_tell(struct dio_viewd *viewd, enum dio_viewd_event_kind kind)
{
	viewd->on_event(viewd, kind);
}

bool dio_viewd_page_is_watched(const struct dio_viewd *viewd)
{
	return viewd->page.asked_ns != 0 && dio_clock_ns() < viewd->page.asked_ns + WATCHED_NS;
}
