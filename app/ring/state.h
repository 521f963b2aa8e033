/* What the camera is doing, as the capture daemon tells its readers. */
#ifndef DIO_RING_STATE_H
#define DIO_RING_STATE_H

/** None of these is an error of the reader: it shows them and waits. */
enum dio_capture_state {
	DIO_CAPTURE_STARTING,  /* the device is being opened, or its first frame is awaited */
	DIO_CAPTURE_STREAMING, /* frames come */
	DIO_CAPTURE_NO_SIGNAL, /* the device is there and its input delivers nothing */
	DIO_CAPTURE_STALLED,   /* frames came and stopped; the device is being restarted */
	DIO_CAPTURE_UNPLUGGED, /* no such device at present */
	DIO_CAPTURE_REFUSED,   /* the device is there and cannot be used; the text says why */
	DIO_CAPTURE_ENDED,     /* a replay is at its end */
	DIO_CAPTURE_ABSENT,    /* the daemon is away; only a client says so */
};

/** One lower-case word or two: "streaming", "no signal". Never NULL. */
const char *dio_capture_state_name(enum dio_capture_state state);

#endif
