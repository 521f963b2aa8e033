/* A contender's side of the talk with compare.py; serve.py says what is said. */
#ifndef TESTS_BENCH_PEERS_TALK_H
#define TESTS_BENCH_PEERS_TALK_H

#include <stddef.h>

/** What a contender can do; `numbers` are those of the last rendering. */
struct talk {
	void *context;
	void (*reconstruct)(void *context);
	void (*render)(void *context);
	const float *numbers;
	size_t count;
};

/** Print `about`, then answer until the input ends. */
void talk_serve(const char *about, const struct talk *talk);

/** Print "PROGRAM: text" and exit 1. */
_Noreturn void talk_fail(const char *text);

#endif
