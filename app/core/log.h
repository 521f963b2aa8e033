/* Messages to standard error, one line each, headed by the program's name. */
#ifndef DIO_APP_LOG_H
#define DIO_APP_LOG_H

/** The name before each line ("diorama"); a constant string. Set once, before any thread starts. */
void dio_log_set_program(const char *name);

__attribute__((format(printf, 1, 2))) void dio_log_error(const char *format, ...);
__attribute__((format(printf, 1, 2))) void dio_log_warn(const char *format, ...);
__attribute__((format(printf, 1, 2))) void dio_log_note(const char *format, ...);

#endif
