/* Cameras and pictures of the double reference (MODEL.md sections 1 to 3). Private to it. */
#ifndef TESTS_SUPPORT_REFERENCE64_PICTURE_H
#define TESTS_SUPPORT_REFERENCE64_PICTURE_H

#include <stddef.h>

#include "dvsm/camera.h"

/** The similarity that brings a rig into the model's frame: c -> scale axes (c - origin). */
struct reference_frame {
	double axes[3][3]; /* rows: the rig's x, y, z */
	double origin[3];
	double scale;
};

struct reference_frame reference_frame_of(const struct dvsm_view *views, uint32_t count);

/** Tokens of a view at a stage's patch side, across and down; halves round up. */
struct reference_grid {
	size_t across, down;
};
struct reference_grid reference_grid_of(const struct dvsm_camera *camera, uint32_t stage_patch_px);

/** Ray map cut into q x q patches: [tokens][q q 6]; release with free(). */
double *reference_rays(const struct dvsm_camera *camera, const struct reference_frame *frame,
		       struct reference_grid grid, uint32_t patch_px);

/** The picture at the map's size, 2 rgb - 1, cut into patches: [tokens][q q 3]; release with
 * free(). */
double *reference_colours(const struct dvsm_view *view, struct reference_grid grid,
			  uint32_t patch_px);

/** Patches [tokens][q q 3] put back and resampled to rgb[height][width][3]. */
void reference_put_back(const double *patches, struct reference_grid grid, uint32_t patch_px,
			const struct dvsm_camera *camera, double *rgb);

#endif
