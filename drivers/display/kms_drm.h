/* One card through libdrm: what kms_drm.c and kms_atomic.c share. */
#ifndef DIO_DISPLAY_KMS_DRM_H
#define DIO_DISPLAY_KMS_DRM_H

#include <libudev.h>
#include <stdbool.h>
#include <stdint.h>
#include <xf86drmMode.h>

#include "kms.h"
#include "terminal.h"

#define DIO_DRM_CRTCS_MAX 8
#define DIO_DRM_FLIPS_MAX 32

/** Property numbers that an atomic commit names; of the route in use. */
struct dio_drm_properties {
	uint32_t plane;
	uint32_t connector_crtc;
	uint32_t crtc_mode, crtc_active;
	uint32_t plane_fb, plane_crtc;
	uint32_t plane_src[4], plane_dst[4]; /* x, y, width, height */
};

struct dio_drm_card {
	int fd, epoll;
	bool atomic;
	uint32_t crtc_count;
	uint32_t crtcs[DIO_DRM_CRTCS_MAX];
	uint32_t touched;                          /* bit i: we changed crtc number i */
	drmModeCrtc *found[DIO_DRM_CRTCS_MAX];     /* as they were */
	uint32_t found_on[DIO_KMS_CONNECTORS_MAX]; /* crtcs that the connectors below were on */
	uint32_t found_connectors[DIO_KMS_CONNECTORS_MAX];
	uint32_t found_count;
	struct dio_drm_properties properties;
	struct udev *udev; /* NULL: what is plugged in later is not noticed */
	struct udev_monitor *monitor;
	struct dio_terminal *terminal;                /* NULL: not run from one */
	struct dio_kms_flip flips[DIO_DRM_FLIPS_MAX]; /* read and not yet taken */
	uint32_t flip_first, flip_count;
};

/** The three commits; -1 sets errno. */
int dio_drm_atomic_set_mode(struct dio_drm_card *card, const struct dio_kms_route *route,
			    uint32_t fb);
int dio_drm_atomic_flip(struct dio_drm_card *card, uint32_t fb, uint64_t cookie);
int dio_drm_atomic_off(struct dio_drm_card *card, const struct dio_kms_route *route);

#endif
