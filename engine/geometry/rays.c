#include "geometry/rays.h"

#include <math.h>

static uint32_t tokens_along(uint32_t length_px, uint32_t patch_px)
{
	uint32_t rounded = (2 * length_px + patch_px) / (2 * patch_px);
	return rounded ? rounded : 1;
}

struct dvsm_token_grid dvsm_token_grid_of(uint32_t width, uint32_t height, uint32_t patch_px)
{
	return (struct dvsm_token_grid){
		.columns = tokens_along(width, patch_px),
		.rows = tokens_along(height, patch_px),
	};
}

struct dvsm_ray_map dvsm_ray_map_prepare(const struct dvsm_camera *camera,
					 const struct dvsm_normalisation *normalisation,
					 uint32_t patch_px, uint32_t stage_patch_px)
{
	struct dvsm_ray_map map = {
		.grid = dvsm_token_grid_of(camera->width, camera->height, stage_patch_px),
		.patch_px = patch_px,
		.pose = dvsm_normalisation_apply(normalisation, camera->world_from_camera),
	};
	double scale_x = (double)map.grid.columns * patch_px / camera->width;
	double scale_y = (double)map.grid.rows * patch_px / camera->height;
	map.fx = camera->fx * scale_x;
	map.fy = camera->fy * scale_y;
	map.cx = (camera->cx + 0.5) * scale_x - 0.5;
	map.cy = (camera->cy + 0.5) * scale_y - 0.5;
	return map;
}

/* The six numbers of pixel (u, v). */
static void ray_at(const struct dvsm_ray_map *map, double u, double v, float out[6])
{
	const double *r = map->pose.rotation;
	const double *o = map->pose.centre;
	double x = (u - map->cx) / map->fx;
	double y = (v - map->cy) / map->fy;
	double dx = r[0] * x + r[1] * y + r[2];
	double dy = r[3] * x + r[4] * y + r[5];
	double dz = r[6] * x + r[7] * y + r[8];
	double length = sqrt(dx * dx + dy * dy + dz * dz);
	dx /= length;
	dy /= length;
	dz /= length;
	out[0] = (float)(o[1] * dz - o[2] * dy);
	out[1] = (float)(o[2] * dx - o[0] * dz);
	out[2] = (float)(o[0] * dy - o[1] * dx);
	out[3] = (float)dx;
	out[4] = (float)dy;
	out[5] = (float)dz;
}

void dvsm_ray_map_write(const struct dvsm_ray_map *map, size_t first_token, size_t count,
			float *patches)
{
	uint32_t q = map->patch_px;
	for (size_t token = first_token; token < first_token + count; token++) {
		size_t token_row = token / map->grid.columns;
		double left = (double)((token - token_row * map->grid.columns) * q);
		double top = (double)(token_row * q);
		for (uint32_t row = 0; row < q; row++) {
			for (uint32_t column = 0; column < q; column++) {
				ray_at(map, left + column, top + row, patches);
				patches += 6;
			}
		}
	}
}
