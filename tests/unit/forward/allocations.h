/* How many allocations the program made and how many blocks are alive (linker option --wrap). */
#ifndef TESTS_UNIT_FORWARD_ALLOCATIONS_H
#define TESTS_UNIT_FORWARD_ALLOCATIONS_H

#include <stddef.h>

size_t allocations_made(void);
long allocations_alive(void);

#endif
