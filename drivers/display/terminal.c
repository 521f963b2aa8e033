#include "terminal.h"

#include <errno.h>
#include <linux/kd.h>
#include <linux/vt.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <unistd.h>

/* The kernel asks by signal whether it may switch. These two are free in glibc and ours. */
#define SIGNAL_LEAVE (SIGRTMIN + 4)
#define SIGNAL_COME  (SIGRTMIN + 5)

/* An eventfd adds up what is written: both can be told apart in the sum. */
#define LEAVE_UNIT ((uint64_t)1 << 32)
#define COME_UNIT  ((uint64_t)1)

struct dio_terminal {
	int event;
	struct vt_mode mode;
	int keyboard;
	struct sigaction leave, come;
};

/* For the handler, which is given nothing else. */
static volatile sig_atomic_t handler_event = -1;

static void on_signal(int number)
{
	const uint64_t unit = number == SIGNAL_LEAVE ? LEAVE_UNIT : COME_UNIT;
	const int cause = errno;

	/* A switch that cannot be told of is refused by the kernel in time: nothing else to do. */
	if (write(handler_event, &unit, sizeof(unit)) < 0)
		errno = cause;
	errno = cause;
}

static void take_signals(struct dio_terminal *terminal)
{
	struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};

	sigfillset(&action.sa_mask);
	handler_event = terminal->event;
	sigaction(SIGNAL_LEAVE, &action, &terminal->leave);
	sigaction(SIGNAL_COME, &action, &terminal->come);
}

struct dio_terminal *dio_terminal_open(void)
{
	struct dio_terminal *terminal;
	struct vt_mode mode = {.mode = VT_PROCESS};
	struct vt_mode before;

	if (handler_event >= 0 || ioctl(STDIN_FILENO, VT_GETMODE, &before) < 0)
		return NULL;
	terminal = calloc(1, sizeof(*terminal));
	if (!terminal)
		return NULL;
	terminal->mode = before;
	terminal->event = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
	if (terminal->event < 0 || ioctl(STDIN_FILENO, KDGKBMODE, &terminal->keyboard) < 0) {
		if (terminal->event >= 0)
			close(terminal->event);
		free(terminal);
		return NULL;
	}
	take_signals(terminal);
	mode.relsig = (short)SIGNAL_LEAVE;
	mode.acqsig = (short)SIGNAL_COME;
	/* Each is a courtesy: without it the picture is shown all the same. */
	(void)ioctl(STDIN_FILENO, VT_SETMODE, &mode);
	(void)ioctl(STDIN_FILENO, KDSETMODE, KD_GRAPHICS);
	(void)ioctl(STDIN_FILENO, KDSKBMODE, K_OFF);
	return terminal;
}

void dio_terminal_close(struct dio_terminal *terminal)
{
	if (!terminal)
		return;
	(void)ioctl(STDIN_FILENO, KDSKBMODE, terminal->keyboard);
	(void)ioctl(STDIN_FILENO, KDSETMODE, KD_TEXT);
	(void)ioctl(STDIN_FILENO, VT_SETMODE, &terminal->mode);
	sigaction(SIGNAL_LEAVE, &terminal->leave, NULL);
	sigaction(SIGNAL_COME, &terminal->come, NULL);
	handler_event = -1;
	close(terminal->event);
	free(terminal);
}

int dio_terminal_get_fd(const struct dio_terminal *terminal)
{
	return terminal->event;
}

enum dio_kms_terminal dio_terminal_read(struct dio_terminal *terminal)
{
	uint64_t sum;

	if (read(terminal->event, &sum, sizeof(sum)) != sizeof(sum))
		return DIO_KMS_TERMINAL_SAME;
	if (sum >= LEAVE_UNIT)
		return DIO_KMS_TERMINAL_LEAVES;
	(void)ioctl(STDIN_FILENO, VT_RELDISP, VT_ACKACQ);
	return DIO_KMS_TERMINAL_COMES;
}

void dio_terminal_leave(struct dio_terminal *terminal)
{
	(void)terminal;
	(void)ioctl(STDIN_FILENO, VT_RELDISP, 1);
}
