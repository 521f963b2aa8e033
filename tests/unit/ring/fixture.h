/* What the ring's tests share: a server in a folder of its own, served by a thread or by hand. */
#ifndef TESTS_RING_FIXTURE_H
#define TESTS_RING_FIXTURE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "ring/ring.h"
#include "ring/ring_client.h"

#define SECOND_NS 1000000000ll

/** A folder per test program. Group set-up and tear-down. */
int ring_fixture_setup(void **state);
int ring_fixture_teardown(void **state);

/** Path of a socket in that folder; borrowed until the next call. */
const char *ring_fixture_path(const char *name);

struct dio_ring_server *ring_fixture_server(const char *path, uint32_t slot_count);
struct dio_ring_client *ring_fixture_client(const char *path, enum dio_ring_order order);

/** A thread that calls dispatch() whenever there is something to do, until it is stopped. */
struct ring_pump;
struct ring_pump *ring_pump_start(struct dio_ring_server *server);
void ring_pump_stop(struct ring_pump *pump);

/** A frame whose every byte follows from `number`, so that a torn one shows. */
void ring_fixture_frame(struct dio_frame *frame, uint8_t *data, size_t size, uint64_t number);
/** Whether all bytes of the data are of that one frame. */
bool ring_fixture_frame_is_whole(const uint8_t *data, size_t size, uint64_t number);

/** Publish frame `number`; fails the test when that fails. */
void ring_fixture_publish(struct dio_ring_server *server, size_t size, uint64_t number);

/** A plain socket connected to the server. */
int ring_fixture_connect(const char *path);

/** Dispatch until `readers` are greeted; fails the test after five seconds. */
void ring_fixture_await_readers(struct dio_ring_server *server, uint32_t readers);

#endif
