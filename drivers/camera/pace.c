#include "pace.h"

#include <errno.h>
#include <time.h>

#include "dio/clock.h"

#define NS_PER_S 1000000000u

bool dio_pace_wait(uint64_t due_ns, int64_t timeout_ns)
{
	uint64_t now = dio_clock_ns();
	uint64_t until = due_ns;
	struct timespec ts;

	if (due_ns > now && due_ns - now > (uint64_t)timeout_ns)
		until = now + (uint64_t)timeout_ns;
	ts = (struct timespec){(time_t)(until / NS_PER_S), (long)(until % NS_PER_S)};
	while (until > now && clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &ts, NULL) == EINTR)
		;
	return until == due_ns;
}
