#include "captured/rate.h"

void dio_rate_reset(struct dio_rate *rate)
{
	rate->count = 0;
}

void dio_rate_add(struct dio_rate *rate, uint64_t timestamp_ns)
{
	rate->times_ns[rate->count % DIO_RATE_FRAMES] = timestamp_ns;
	rate->count++;
}

double dio_rate_get(const struct dio_rate *rate)
{
	uint32_t kept = rate->count < DIO_RATE_FRAMES ? rate->count : DIO_RATE_FRAMES;
	uint64_t oldest, newest;

	if (kept < 2)
		return 0;
	oldest = rate->times_ns[(rate->count - kept) % DIO_RATE_FRAMES];
	newest = rate->times_ns[(rate->count - 1) % DIO_RATE_FRAMES];
	return newest > oldest ? (kept - 1) * 1e9 / (double)(newest - oldest) : 0;
}
