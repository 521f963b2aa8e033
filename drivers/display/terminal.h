/* The virtual terminal a program runs on (systemd: StandardInput=tty, TTYPath=): its text and keys
 * are kept from a screen that is ours, and it can be switched away from. */
#ifndef DIO_DISPLAY_TERMINAL_H
#define DIO_DISPLAY_TERMINAL_H

#include "kms.h"

/** Opaque. One a process. */
struct dio_terminal;

/** NULL when standard input is no virtual terminal: then there is nothing to do. */
struct dio_terminal *dio_terminal_open(void);
/** Text and keys as before. NULL is fine. */
void dio_terminal_close(struct dio_terminal *terminal);

/** Readable when dio_terminal_read() has news. */
int dio_terminal_get_fd(const struct dio_terminal *terminal);

/** After DIO_KMS_TERMINAL_LEAVES the switch waits for dio_terminal_leave(). */
enum dio_kms_terminal dio_terminal_read(struct dio_terminal *terminal);
void dio_terminal_leave(struct dio_terminal *terminal);

#endif
