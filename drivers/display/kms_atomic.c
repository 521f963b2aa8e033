#include <drm_fourcc.h>
#include <errno.h>
#include <string.h>
#include <xf86drm.h>

#include "kms_drm.h"

/* A property's number by its name, and its value; 0 when the object has none of that name. */
static uint32_t find_property(int fd, uint32_t object, uint32_t type, const char *name,
			      uint64_t *value)
{
	drmModeObjectProperties *all = drmModeObjectGetProperties(fd, object, type);
	uint32_t found = 0;

	for (uint32_t i = 0; all && i < all->count_props && !found; i++) {
		drmModePropertyRes *property = drmModeGetProperty(fd, all->props[i]);

		if (property && strcmp(property->name, name) == 0) {
			found = property->prop_id;
			if (value)
				*value = all->prop_values[i];
		}
		drmModeFreeProperty(property);
	}
	drmModeFreeObjectProperties(all);
	return found;
}

static bool scans_out(const drmModePlane *plane, uint32_t format)
{
	for (uint32_t i = 0; i < plane->count_formats; i++)
		if (plane->formats[i] == format)
			return true;
	return false;
}

/* The plane that is the crtc's own, if it can show our format. */
static uint32_t find_plane(int fd, uint32_t crtc)
{
	drmModePlaneRes *all = drmModeGetPlaneResources(fd);
	uint32_t found = 0;

	for (uint32_t i = 0; all && i < all->count_planes && !found; i++) {
		drmModePlane *plane = drmModeGetPlane(fd, all->planes[i]);
		uint64_t type = DRM_PLANE_TYPE_OVERLAY;

		find_property(fd, all->planes[i], DRM_MODE_OBJECT_PLANE, "type", &type);
		if (plane && type == DRM_PLANE_TYPE_PRIMARY && plane->possible_crtcs >> crtc & 1 &&
		    scans_out(plane, DRM_FORMAT_XRGB8888))
			found = plane->plane_id;
		drmModeFreePlane(plane);
	}
	drmModeFreePlaneResources(all);
	return found;
}

static int find_properties(struct dio_drm_card *card, const struct dio_kms_route *route)
{
	static const char *const src[] = {"SRC_X", "SRC_Y", "SRC_W", "SRC_H"};
	static const char *const dst[] = {"CRTC_X", "CRTC_Y", "CRTC_W", "CRTC_H"};
	struct dio_drm_properties *p = &card->properties;
	const uint32_t crtc = card->crtcs[route->crtc];
	const int fd = card->fd;
	bool all;

	p->plane = find_plane(fd, route->crtc);
	p->connector_crtc =
		find_property(fd, route->connector_id, DRM_MODE_OBJECT_CONNECTOR, "CRTC_ID", NULL);
	p->crtc_mode = find_property(fd, crtc, DRM_MODE_OBJECT_CRTC, "MODE_ID", NULL);
	p->crtc_active = find_property(fd, crtc, DRM_MODE_OBJECT_CRTC, "ACTIVE", NULL);
	p->plane_fb = find_property(fd, p->plane, DRM_MODE_OBJECT_PLANE, "FB_ID", NULL);
	p->plane_crtc = find_property(fd, p->plane, DRM_MODE_OBJECT_PLANE, "CRTC_ID", NULL);
	all = p->plane && p->connector_crtc && p->crtc_mode && p->crtc_active && p->plane_fb &&
	      p->plane_crtc;
	for (int i = 0; i < 4; i++) {
		p->plane_src[i] = find_property(fd, p->plane, DRM_MODE_OBJECT_PLANE, src[i], NULL);
		p->plane_dst[i] = find_property(fd, p->plane, DRM_MODE_OBJECT_PLANE, dst[i], NULL);
		all = all && p->plane_src[i] && p->plane_dst[i];
	}
	if (!all)
		errno = EOPNOTSUPP;
	return all ? 0 : -1;
}

/* A request that grows; a failure on the way is told at the end. */
struct request {
	drmModeAtomicReq *atomic;
	bool failed;
};

static void add(struct request *request, uint32_t object, uint32_t property, uint64_t value)
{
	if (!request->atomic ||
	    drmModeAtomicAddProperty(request->atomic, object, property, value) < 0)
		request->failed = true;
}

static int commit(const struct dio_drm_card *card, struct request *request, uint32_t flags,
		  uint64_t cookie)
{
	int result = -ENOMEM;

	if (!request->failed) {
		/* The kernel hands the cookie back as it is: it is no pointer to it. */
		/* NOLINTNEXTLINE(performance-no-int-to-ptr) */
		void *const data = (void *)(uintptr_t)cookie;

		result = drmModeAtomicCommit(card->fd, request->atomic, flags, data);
	}
	drmModeAtomicFree(request->atomic);
	if (result == 0)
		return 0;
	errno = -result;
	return -1;
}

int dio_drm_atomic_set_mode(struct dio_drm_card *card, const struct dio_kms_route *route,
			    uint32_t fb)
{
	const struct dio_drm_properties *p = &card->properties;
	const uint64_t width = route->mode.hdisplay, height = route->mode.vdisplay;
	/* The source is counted in 65536ths of a pixel. */
	const uint64_t src[] = {0, 0, width << 16, height << 16}, dst[] = {0, 0, width, height};
	const uint32_t crtc = card->crtcs[route->crtc];
	struct request request = {0};
	uint32_t blob = 0;
	int result;

	if (find_properties(card, route) < 0)
		return -1;
	result = drmModeCreatePropertyBlob(card->fd, &route->mode, sizeof(route->mode), &blob);
	if (result < 0) {
		errno = -result;
		return -1;
	}
	request.atomic = drmModeAtomicAlloc();
	add(&request, route->connector_id, p->connector_crtc, crtc);
	add(&request, crtc, p->crtc_mode, blob);
	add(&request, crtc, p->crtc_active, 1);
	add(&request, p->plane, p->plane_fb, fb);
	add(&request, p->plane, p->plane_crtc, crtc);
	for (int i = 0; i < 4; i++) {
		add(&request, p->plane, p->plane_src[i], src[i]);
		add(&request, p->plane, p->plane_dst[i], dst[i]);
	}
	result = commit(card, &request, DRM_MODE_ATOMIC_ALLOW_MODESET, 0);
	/* The crtc keeps the blob while it uses it. */
	int cause = errno;
	drmModeDestroyPropertyBlob(card->fd, blob);
	errno = cause;
	return result;
}

int dio_drm_atomic_flip(struct dio_drm_card *card, uint32_t fb, uint64_t cookie)
{
	struct request request = {.atomic = drmModeAtomicAlloc()};

	add(&request, card->properties.plane, card->properties.plane_fb, fb);
	return commit(card, &request, DRM_MODE_ATOMIC_NONBLOCK | DRM_MODE_PAGE_FLIP_EVENT, cookie);
}

int dio_drm_atomic_off(struct dio_drm_card *card, const struct dio_kms_route *route)
{
	const struct dio_drm_properties *p = &card->properties;
	const uint32_t crtc = card->crtcs[route->crtc];
	struct request request = {.atomic = drmModeAtomicAlloc()};

	add(&request, route->connector_id, p->connector_crtc, 0);
	add(&request, crtc, p->crtc_mode, 0);
	add(&request, crtc, p->crtc_active, 0);
	add(&request, p->plane, p->plane_fb, 0);
	add(&request, p->plane, p->plane_crtc, 0);
	return commit(card, &request, DRM_MODE_ATOMIC_ALLOW_MODESET, 0);
}
