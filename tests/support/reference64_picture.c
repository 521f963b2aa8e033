#include "support/reference64_picture.h"

#include <math.h>
#include <stdlib.h>

#include "support/reference64.h"

/* Section 2: pose normalisation */

static double dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
	out[0] = a[1] * b[2] - a[2] * b[1];
	out[1] = a[2] * b[0] - a[0] * b[2];
	out[2] = a[0] * b[1] - a[1] * b[0];
}

/* To length 1; what it was before. */
static double normalise(double a[3])
{
	double length = sqrt(dot(a, a));

	for (int i = 0; i < 3; i++)
		a[i] /= length;
	return length;
}

/* Counted from the first view's number: a mean of equal numbers is that number, however large. */
static double mean_of_column(const struct dvsm_view *views, uint32_t count, int row, int column)
{
	double first = views[0].camera.world_from_camera[4 * row + column], sum = 0;

	for (uint32_t v = 0; v < count; v++)
		sum += views[v].camera.world_from_camera[4 * row + column] - first;
	return first + sum / count;
}

/* axes (c - origin) */
static void place(const struct reference_frame *frame, const double pose[16], double out[3])
{
	const double offset[3] = {pose[3] - frame->origin[0], pose[7] - frame->origin[1],
				  pose[11] - frame->origin[2]};

	for (int i = 0; i < 3; i++)
		out[i] = dot(frame->axes[i], offset);
}

struct reference_frame reference_frame_of(const struct dvsm_view *views, uint32_t count)
{
	struct reference_frame frame = {.scale = 1};
	double mean_y[3], *x = frame.axes[0], *y = frame.axes[1], *z = frame.axes[2];
	double extent = 0, placed[3];

	for (int i = 0; i < 3; i++) {
		mean_y[i] = mean_of_column(views, count, i, 1);
		z[i] = mean_of_column(views, count, i, 2);
		frame.origin[i] = mean_of_column(views, count, i, 3);
	}

	bool usable = normalise(z) > 1e-6;

	cross(mean_y, z, x);
	usable = usable && normalise(x) > 1e-6;
	cross(z, x, y);
	for (int i = 0; !usable && i < 9; i++)
		frame.axes[i % 3][i / 3] = views[0].camera.world_from_camera[4 * (i / 3) + i % 3];

	for (uint32_t v = 0; v < count; v++) {
		place(&frame, views[v].camera.world_from_camera, placed);
		for (int i = 0; i < 3; i++)
			extent = fmax(extent, fabs(placed[i]));
	}
	if (extent > 1e-9)
		frame.scale = 1 / (1.35 * extent);
	return frame;
}

/* Section 3: maps and patches */

static size_t tokens_along(uint32_t length, uint32_t patch_px)
{
	double tokens = floor((double)length / patch_px + 0.5);

	return tokens < 1 ? 1 : (size_t)tokens;
}

struct reference_grid reference_grid_of(const struct dvsm_camera *camera, uint32_t stage_patch_px)
{
	return (struct reference_grid){
		tokens_along(camera->width, stage_patch_px),
		tokens_along(camera->height, stage_patch_px),
	};
}

/* Where a map's pixel lies in its patches, flattened as (row, column, channel). */
static size_t place_in_patches(size_t x, size_t y, struct reference_grid grid, uint32_t q,
			       size_t channels)
{
	size_t token = y / q * grid.across + x / q;

	return (token * q * q + y % q * q + x % q) * channels;
}

/* (o cross d, d) through pixel (u, v) of a map. */
static void ray(const double rotation[3][3], const double centre[3], double x, double y,
		double out[6])
{
	const double in_camera[3] = {x, y, 1};
	double *direction = out + 3;

	for (int i = 0; i < 3; i++)
		direction[i] = dot(rotation[i], in_camera);
	normalise(direction);
	cross(centre, direction, out);
}

double *reference_rays(const struct dvsm_camera *camera, const struct reference_frame *frame,
		       struct reference_grid grid, uint32_t patch_px)
{
	const size_t width = grid.across * patch_px, height = grid.down * patch_px;
	const double scale_x = (double)width / camera->width;
	const double scale_y = (double)height / camera->height;
	const double cx = (camera->cx + 0.5) * scale_x - 0.5;
	const double cy = (camera->cy + 0.5) * scale_y - 0.5;
	double *patches = support_reference_allocate(width * height * 6, sizeof(double));
	double rotation[3][3], centre[3];

	for (int i = 0; i < 3; i++) {
		for (int j = 0; j < 3; j++) {
			const double *pose = camera->world_from_camera;
			const double axis[3] = {pose[j], pose[4 + j], pose[8 + j]};

			rotation[i][j] = dot(frame->axes[i], axis);
		}
	}
	place(frame, camera->world_from_camera, centre);
	for (int i = 0; i < 3; i++)
		centre[i] *= frame->scale;

	for (size_t y = 0; y < height; y++) {
		for (size_t x = 0; x < width; x++)
			ray(rotation, centre, ((double)x - cx) / (camera->fx * scale_x),
			    ((double)y - cy) / (camera->fy * scale_y),
			    patches + place_in_patches(x, y, grid, patch_px, 6));
	}
	return patches;
}

/* Section 1: resampling. Weights of the old samples in each new one, [new][old]. */
static double *resampling_matrix(size_t old, size_t new)
{
	double *matrix = support_reference_allocate(old * new, sizeof(double));

	for (size_t i = 0; i < new; i++) {
		double *row = matrix + i * old;
		double ratio = (double)old / (double)new;

		if (new < old) {
			double begin = (double)i * ratio, end = (double)(i + 1) * ratio;

			for (size_t j = 0; j < old; j++)
				row[j] =
					fmax(0, fmin(end, (double)j + 1) - fmax(begin, (double)j)) /
					ratio;
		} else {
			double position = ((double)i + 0.5) * ratio - 0.5, left = floor(position);
			size_t last = old - 1, after = left < 0 ? 0 : (size_t)left + 1;

			row[left < 0 ? 0 : (size_t)left] += 1 - (position - left);
			row[after < last ? after : last] += position - left;
		}
	}
	return matrix;
}

/* One axis of picture[outer][old][inner] after the other; weights that are 0 are passed over. */
static void resample_axis(const double *picture, size_t outer, size_t old, size_t new, size_t inner,
			  double *out)
{
	double *matrix = resampling_matrix(old, new);

	for (size_t o = 0; o < outer; o++) {
		for (size_t i = 0; i < new; i++) {
			double *to = out + (o * new + i) * inner;

			for (size_t n = 0; n < inner; n++)
				to[n] = 0;
			for (size_t j = 0; j < old; j++) {
				const double *from = picture + (o * old + j) * inner;
				double weight = matrix[i * old + j];

				for (size_t n = 0; weight != 0 && n < inner; n++)
					to[n] += weight * from[n];
			}
		}
	}
	free(matrix);
}

static void resample(const double *picture, size_t width, size_t height, size_t new_width,
		     size_t new_height, double *out)
{
	double *rows = support_reference_allocate(new_height * width * 3, sizeof(double));

	resample_axis(picture, 1, height, new_height, width * 3, rows);
	resample_axis(rows, new_height, width, new_width, 3, out);
	free(rows);
}

double *reference_colours(const struct dvsm_view *view, struct reference_grid grid,
			  uint32_t patch_px)
{
	const size_t width = grid.across * patch_px, height = grid.down * patch_px;
	const size_t numbers = (size_t)view->camera.width * view->camera.height * 3;
	double *picture = support_reference_allocate(numbers, sizeof(double));
	double *map = support_reference_allocate(width * height * 3, sizeof(double));
	double *patches = support_reference_allocate(width * height * 3, sizeof(double));

	for (size_t i = 0; i < numbers; i++)
		picture[i] = view->rgb[i];
	resample(picture, view->camera.width, view->camera.height, width, height, map);
	for (size_t y = 0; y < height; y++) {
		for (size_t x = 0; x < width; x++) {
			double *to = patches + place_in_patches(x, y, grid, patch_px, 3);

			for (int c = 0; c < 3; c++)
				to[c] = 2 * map[(y * width + x) * 3 + (size_t)c] - 1;
		}
	}
	free(picture);
	free(map);
	return patches;
}

void reference_put_back(const double *patches, struct reference_grid grid, uint32_t patch_px,
			const struct dvsm_camera *camera, double *rgb)
{
	const size_t width = grid.across * patch_px, height = grid.down * patch_px;
	double *map = support_reference_allocate(width * height * 3, sizeof(double));

	for (size_t y = 0; y < height; y++) {
		for (size_t x = 0; x < width; x++) {
			const double *from = patches + place_in_patches(x, y, grid, patch_px, 3);

			for (int c = 0; c < 3; c++)
				map[(y * width + x) * 3 + (size_t)c] = from[c];
		}
	}
	resample(map, width, height, camera->width, camera->height, rgb);
	free(map);
}
