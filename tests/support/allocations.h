/* How many allocations the program made and how many blocks are alive (linker option --wrap). */
#ifndef TESTS_SUPPORT_ALLOCATIONS_H
#define TESTS_SUPPORT_ALLOCATIONS_H

#include <stddef.h>

size_t allocations_made(void);
long allocations_alive(void);

#endif
