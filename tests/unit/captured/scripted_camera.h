/* A camera for the daemon's tests: the linker puts it in place of dio_camera_*(), and the test
 * tells it by shared memory what to do. */
#ifndef TESTS_CAPTURED_SCRIPTED_CAMERA_H
#define TESTS_CAPTURED_SCRIPTED_CAMERA_H

#include <stdatomic.h>
#include <stdint.h>

/** The environment variable with the file that both sides map. */
#define SCRIPT_VARIABLE "DIO_TEST_CAMERA"

enum script_mode {
	SCRIPT_STREAM,
	SCRIPT_ABSENT,    /* pulled out: DIO_GONE, then DIO_NOT_FOUND */
	SCRIPT_SILENT,    /* gives no more frames */
	SCRIPT_NO_SIGNAL, /* says that its input has none */
	SCRIPT_REFUSED,   /* cannot be opened: no format in common */
	SCRIPT_BROKEN,    /* DIO_IO at every frame */
	SCRIPT_HANGING,   /* its driver never returns */
	SCRIPT_END,       /* as a replay that is over */
};

/** Shared; zero-filled is a camera that streams 100 frames a second. */
struct script {
	_Atomic uint32_t mode;
	_Atomic uint32_t rate;   /* frames a second; 0: 100 */
	_Atomic uint32_t level;  /* grey of its picture */
	_Atomic uint32_t drift;  /* added to the grey with each frame: it has not settled */
	_Atomic uint32_t deaf;   /* does not obey when white balance is to be held */
	_Atomic uint32_t larger; /* its picture has twice the side from the next opening on */
	_Atomic uint32_t opened; /* times */
	_Atomic uint32_t held;   /* exposure is held now */
	_Atomic uint64_t frames; /* delivered in all */
};

/** Its pictures are grey, this many pixels a side; the first 8 bytes are the frame's number. */
#define SCRIPT_SIDE 64u

#endif
