/* The socket behind which a ring's readers are awaited. */
#ifndef DIO_RING_LISTEN_H
#define DIO_RING_LISTEN_H

#include <sys/socket.h>
#include <sys/types.h>
#include <sys/un.h>

#include "dio/status.h"

/** Fill in an address. DIO_BAD_ARG: the path is empty or too long. */
enum dio_status dio_ring_address(const char *path, struct sockaddr_un *address,
				 struct dio_error *error);

/**
 * Make a listening SOCK_SEQPACKET socket, replacing a socket file that nobody listens behind.
 *
 * DIO_BUSY  somebody listens there, or the file is no socket
 */
enum dio_status dio_ring_listen(const char *path, mode_t mode, int *fd, struct dio_error *error);

/** Check a socket that was handed over: listening, SOCK_SEQPACKET; made non-blocking. */
enum dio_status dio_ring_listen_check(int fd, struct dio_error *error);

#endif
