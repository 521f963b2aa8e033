/* The clock of cameras that are no device: frames become due one after another. */
#ifndef DIO_CAMERA_PACE_H
#define DIO_CAMERA_PACE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Sleep until `due_ns` but no longer than `timeout_ns`; true when it is due. */
bool dio_pace_wait(uint64_t due_ns, int64_t timeout_ns);

#ifdef __cplusplus
}
#endif
#endif
