/* A graphics card that does what it is told and takes notes, for the table in kms.h. */
#ifndef FAKE_KMS_H
#define FAKE_KMS_H

#include "kms.h"

#define FAKE_CARDS   2
#define FAKE_BUFFERS 16

struct fake_card {
	const char *path;
	int open_errno, probe_errno;
	struct dio_kms_outputs outputs;
};

struct fake_kms {
	/* The script. */
	uint32_t card_count;
	struct fake_card cards[FAKE_CARDS];
	int flip_errno, set_mode_errno, reclaim_errno, create_errno;
	uint16_t refused_width;   /* modes so wide are refused with EINVAL */
	uint32_t create_fails_at; /* the buffer of that number, from 1, fails with create_errno */

	/* What happened. */
	uint32_t opened, created, destroyed, modes_set, turned_off, restored, released, reclaimed;
	bool restored_before_destroy;
	struct dio_kms_route route; /* that is on */
	bool is_on;
	uint32_t shown;    /* frame buffer on the screen */
	uint32_t flipping; /* on its way; 0: none */
	uint64_t cookie;
	uint8_t *memory[FAKE_BUFFERS]; /* of frame buffer i + 1 */

	/* News that waits to be read. */
	struct dio_kms_flip flips[4];
	uint32_t flip_count;
	bool hotplug;
	enum dio_kms_terminal terminal;
	int event; /* eventfd */
	int read_errno;
	struct dio_kms_system system;
};

/** One card with one screen on HDMI-A-1: 192x108 preferred, 128x72, both at 60 Hz. */
void fake_kms_init(struct fake_kms *fake);
void fake_kms_deinit(struct fake_kms *fake);

/** A vertical blank: what is on its way is on the screen, at that time. */
void fake_kms_vblank(struct fake_kms *fake, uint64_t time_ns);

void fake_kms_plug(struct fake_kms *fake, bool connected);
void fake_kms_switch(struct fake_kms *fake, enum dio_kms_terminal terminal);

/** The first pixel of what is on the screen. */
uint32_t fake_kms_pixel(const struct fake_kms *fake);

drmModeModeInfo fake_kms_mode(uint16_t width, uint16_t height, uint32_t hz, bool preferred);

#endif
