/* What a process has and uses, by /proc. */
#ifndef TESTS_APPLIANCE_PROCESS_H
#define TESTS_APPLIANCE_PROCESS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

struct process_sample {
	double at_s;      /* CLOCK_MONOTONIC */
	double worked_s;  /* processor time since it began */
	uint64_t pss_kib; /* its share of the memory it maps, */
	uint64_t own_kib; /* without program files: those come and go with other programs */
	uint32_t descriptors, threads;
};

/** false: it is not there, or /proc says less than it should. */
bool process_sample(pid_t pid, struct process_sample *sample);

/** Share of one processor between two samples. */
double process_share(const struct process_sample *from, const struct process_sample *to);

#endif
