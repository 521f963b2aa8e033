/* Token grids and Plücker ray maps (MODEL.md section 3). Private to the engine. */
#ifndef DVSM_GEOMETRY_RAYS_H
#define DVSM_GEOMETRY_RAYS_H

#include <stddef.h>
#include <stdint.h>

#include "dvsm/camera.h"
#include "geometry/pose.h"

/** Tokens of one picture: `columns` x `rows`, row-major. */
struct dvsm_token_grid {
	uint32_t columns; /* gw = max(1, round(W/p)) */
	uint32_t rows;    /* gh = max(1, round(H/p)) */
};

/** Grid of a W x H picture cut with stage patch p (1..256); round half up. */
struct dvsm_token_grid dvsm_token_grid_of(uint32_t width, uint32_t height, uint32_t patch_px);

/** Tokens of the grid; at most 16384^2, so it cannot overflow. */
static inline size_t dvsm_token_grid_count(struct dvsm_token_grid grid)
{
	return (size_t)grid.columns * grid.rows;
}

/** Tokens of a camera's picture cut with stage patch p. */
static inline size_t dvsm_camera_tokens(const struct dvsm_camera *camera, uint32_t patch_px)
{
	return dvsm_token_grid_count(dvsm_token_grid_of(camera->width, camera->height, patch_px));
}

/** One camera's ray map at (columns q) x (rows q) pixels: grid, scaled intrinsics, pose. */
struct dvsm_ray_map {
	struct dvsm_token_grid grid;
	uint32_t patch_px; /* q, patch side of the weights */
	double fx, fy, cx, cy;
	struct dvsm_pose pose;
};

/**
 * Prepare the ray map of a checked camera.
 *
 * patch_px        q, patch side of the weights
 * stage_patch_px  p, which decides the grid
 */
struct dvsm_ray_map dvsm_ray_map_prepare(const struct dvsm_camera *camera,
					 const struct dvsm_normalisation *normalisation,
					 uint32_t patch_px, uint32_t stage_patch_px);

/**
 * Evaluate tokens first_token .. first_token + count - 1 as flattened patches.
 *
 * patches   receives [count][q*q*6] float: per pixel (row, column) the six of (o x d, d)
 *
 * Reentrant. Computed in double with + - * / and sqrt alone, so the bits are the same everywhere.
 */
void dvsm_ray_map_write(const struct dvsm_ray_map *map, size_t first_token, size_t count,
			float *patches);

#endif
