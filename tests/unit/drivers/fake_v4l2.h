/* A scripted V4L2 device with a clock of its own, for the table of system calls in v4l2_system.h.
 */
#ifndef FAKE_V4L2_H
#define FAKE_V4L2_H

#include <linux/videodev2.h>
#include <stdbool.h>
#include <stdint.h>

#include "v4l2_system.h"

#define FAKE_BUFFERS_MAX  8
#define FAKE_FRAMES_MAX   64
#define FAKE_MODES_MAX    8
#define FAKE_CONTROLS_MAX 12
#define FAKE_DMABUF_FD    2000

/* One size and rate at which a pixel format is offered. */
struct fake_mode {
	uint32_t fourcc, width, height;
	uint32_t fps;
};

/* A frame that the sensor finishes at a time; it is dropped when no buffer waits for it. */
struct fake_frame {
	uint64_t at_ms;
	uint32_t sequence;
	uint32_t flags;      /* besides the clock's */
	uint32_t bytes_less; /* than a whole frame */
};

/* A control of the device. */
struct fake_control {
	uint32_t id;
	int32_t min, max, value;
	uint32_t menu; /* bit n: item n is offered; 0: all */
	bool deaf;     /* takes a value and does nothing */
	bool forgets;  /* when this is written, every value control falls back to its minimum */
};

struct fake_v4l2 {
	/* The script. */
	struct fake_control controls[FAKE_CONTROLS_MAX];
	bool has_input;        /* ENUMINPUT is there */
	uint32_t input_status; /* V4L2_IN_ST_* */
	bool has_timings;      /* a receiver: DV timings and source changes */
	uint32_t signal_width, signal_height;
	bool change_waits; /* a source change that was not fetched yet */
	bool exports;
	int open_errno;
	uint32_t caps;
	struct fake_mode modes[FAKE_MODES_MAX];
	struct fake_frame frames[FAKE_FRAMES_MAX];
	uint32_t force_fourcc, force_width, force_height, pad_bytes, force_field, force_planes;
	uint32_t buffers_given; /* 0: as many as asked */
	uint32_t clock_flag;    /* V4L2_BUF_FLAG_TIMESTAMP_* */
	uint64_t unplug_at_ms;  /* 0: never */
	uint32_t interruptions; /* poll() calls that end with EINTR */
	bool poll_error;        /* POLLERR without a cause */
	bool steps;             /* sizes are a range from modes[0] to modes[1] in steps of 16 */

	/* The call number `fail_call` (from 1) fails with fail_errno; so do all of request
	 * fail_ioctl. */
	unsigned fail_call, fail_ioctl;
	int fail_errno;

	/* The state. */
	uint64_t now_ns;
	unsigned calls;
	bool is_open, is_streaming;
	struct v4l2_pix_format pix;
	struct v4l2_fract interval;
	uint32_t buffer_count;
	unsigned mapped_count;
	uint8_t *memory[FAKE_BUFFERS_MAX];
	struct v4l2_buffer done[FAKE_BUFFERS_MAX]; /* oldest first */
	uint32_t done_count, queue[FAKE_BUFFERS_MAX], queue_count;
	size_t next_frame;
	unsigned set_rates, exported_count;
	struct v4l2_bt_timings timings;
	bool is_subscribed;
};

/** A webcam: YUYV 640x480 at 30 frames a second, frames every 33 ms numbered from 0. */
void fake_v4l2_init(struct fake_v4l2 *fake);

struct dio_v4l2_system fake_v4l2_system(struct fake_v4l2 *fake);

/** Let time pass: the sensor fills what buffers it has. */
void fake_v4l2_advance(struct fake_v4l2 *fake, uint64_t to_ms);

#endif
