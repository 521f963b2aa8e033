#include <math.h>
#include <string.h>

#include "kms.h"

double dio_kms_refresh_hz(const drmModeModeInfo *mode)
{
	double hz;

	if (mode->htotal == 0 || mode->vtotal == 0)
		return mode->vrefresh;
	hz = mode->clock * 1000.0 / mode->htotal / mode->vtotal;
	if (mode->flags & DRM_MODE_FLAG_INTERLACE)
		hz *= 2;
	if (mode->flags & DRM_MODE_FLAG_DBLSCAN)
		hz /= 2;
	return mode->vscan > 1 ? hz / mode->vscan : hz;
}

/* How well a mode serves, more is better: the wished size, the wished rate, the screen's own
 * preference, no interlace, then size. */
static double score(const drmModeModeInfo *mode, const struct dio_display_mode *wish)
{
	const double hz = dio_kms_refresh_hz(mode);
	double sum = (double)mode->hdisplay * mode->vdisplay / 1e9;

	if (mode->type & DRM_MODE_TYPE_PREFERRED)
		sum += 10;
	if (!(mode->flags & DRM_MODE_FLAG_INTERLACE))
		sum += 5;
	if (wish->width && mode->hdisplay == wish->width && mode->vdisplay == wish->height)
		sum += 1000;
	/* 59.94 passes for 60 where there is no 60. */
	if (wish->refresh_hz > 0 && fabs(hz - wish->refresh_hz) < 0.5)
		sum += 100 - fabs(hz - wish->refresh_hz);
	return sum;
}

static int choose_mode(const struct dio_kms_connector *connector,
		       const struct dio_display_mode *wish, uint64_t refused)
{
	int best = -1;
	double best_score = 0;

	for (uint32_t i = 0; i < connector->mode_count; i++) {
		const double value = score(&connector->modes[i], wish);

		if ((refused >> i & 1) == 0 && (best < 0 || value > best_score)) {
			best = (int)i;
			best_score = value;
		}
	}
	return best;
}

/* The one in use, so that nothing else need change; else the first. */
static int choose_crtc(const struct dio_kms_connector *connector, uint32_t crtc_count)
{
	if (connector->current_crtc >= 0 &&
	    connector->possible_crtcs >> connector->current_crtc & 1)
		return connector->current_crtc;
	for (uint32_t i = 0; i < crtc_count && i < 32; i++)
		if (connector->possible_crtcs >> i & 1)
			return (int)i;
	return -1;
}

bool dio_kms_choose(const struct dio_kms_outputs *outputs, const struct dio_kms_wish *wish,
		    uint64_t refused, struct dio_kms_route *route, uint32_t *mode)
{
	for (uint32_t i = 0; i < outputs->connector_count; i++) {
		const struct dio_kms_connector *connector = &outputs->connectors[i];
		int best, crtc;

		if (!connector->connected ||
		    (wish->connector[0] && strcmp(wish->connector, connector->name) != 0))
			continue;
		best = choose_mode(connector, &wish->mode, refused);
		crtc = choose_crtc(connector, outputs->crtc_count);
		if (best < 0 || crtc < 0)
			continue;
		*route = (struct dio_kms_route){.connector_id = connector->id,
						.crtc = (uint32_t)crtc,
						.mode = connector->modes[best]};
		memcpy(route->connector_name, connector->name, sizeof(route->connector_name));
		*mode = (uint32_t)best;
		return true;
	}
	return false;
}
