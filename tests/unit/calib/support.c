#include "support.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

const char *shared_folder(const char *path, char *buffer, size_t size)
{
	const char *root = getenv("DIO_SHARED_DIR");
	struct stat status;

	snprintf(buffer, size, "%s/%s", root ? root : "", path);
	if (root && stat(buffer, &status) == 0 && S_ISDIR(status.st_mode))
		return buffer;
	print_message("skipped: %s is not there (DIO_SHARED_DIR)\n", buffer);
	return NULL;
}

struct dio_board board_of(const char *spec)
{
	struct dio_board board = {0};
	struct dio_error error = {""};

	if (dio_board_parse(spec, &board, &error) != DIO_OK)
		fail_msg("%s", error.text);
	return board;
}

static void detect_file(struct corner_set *set, struct dio_board_detector *detector,
			const char *path)
{
	struct dio_picture picture = {0};
	struct dio_error error = {""};

	if (dio_picture_read(path, &picture, &error) != DIO_OK)
		fail_msg("%s", error.text);
	set->width = picture.width;
	set->height = picture.height;
	if (dio_board_detect(detector, &picture, &set->corners[set->count], &error) != DIO_OK)
		fail_msg("%s", error.text);
	set->count++;
	dio_picture_deinit(&picture);
}

void corner_set_load(struct corner_set *set, const char *spec, const char *folder,
		     const char *prefix)
{
	struct dio_board board = board_of(spec);
	struct dio_board_detector *detector = NULL;
	struct dirent **entries = NULL;
	int entry_count = scandir(folder, &entries, NULL, alphasort);

	assert_true(entry_count > 0);
	assert_int_equal(dio_board_detector_create(&board, &detector, NULL), DIO_OK);
	memset(set, 0, sizeof(*set));
	set->corners = calloc((size_t)entry_count, sizeof(*set->corners));
	assert_non_null(set->corners);
	for (int i = 0; i < entry_count; i++) {
		char path[1024];

		snprintf(path, sizeof(path), "%s/%s", folder, entries[i]->d_name);
		if (entries[i]->d_name[0] != '.' &&
		    strncmp(entries[i]->d_name, prefix, strlen(prefix)) == 0)
			detect_file(set, detector, path);
		free(entries[i]);
	}
	free(entries);
	set->board = *dio_board_detector_get_board(detector);
	dio_board_detector_destroy(detector);
}

void corner_set_free(struct corner_set *set)
{
	for (uint32_t i = 0; i < set->count; i++)
		dio_corners_deinit(&set->corners[i]);
	free(set->corners);
}

double noise(uint64_t *seed)
{
	double uniform[2];

	for (int i = 0; i < 2; i++) {
		*seed = *seed * 6364136223846793005u + 1442695040888963407u;
		uniform[i] = ((double)(*seed >> 11) + 0.5) / 9007199254740992.0;
	}
	return sqrt(-2 * log(uniform[0])) * cos(2 * M_PI * uniform[1]);
}

static void normalise(double v[3])
{
	double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

	for (int i = 0; i < 3; i++)
		v[i] /= length;
}

static void cross(const double a[3], const double b[3], double out[3])
{
	out[0] = a[1] * b[2] - a[2] * b[1];
	out[1] = a[2] * b[0] - a[0] * b[2];
	out[2] = a[0] * b[1] - a[1] * b[0];
}

struct dio_pose look_at(const double eye[3], const double target[3], double roll_deg)
{
	double z[3], x[3], y[3];
	double c = cos(roll_deg * M_PI / 180), s = sin(roll_deg * M_PI / 180);
	/* Not quite +y, so that a camera on the y axis has a top too. */
	const double up[3] = {0.001, 1, 0.0013};
	struct dio_pose pose = {{0}};

	for (int i = 0; i < 3; i++)
		z[i] = target[i] - eye[i];
	normalise(z);
	cross(z, up, x);
	normalise(x);
	cross(z, x, y);
	for (int i = 0; i < 3; i++) {
		pose.world_from_camera[4 * i] = c * x[i] + s * y[i];
		pose.world_from_camera[4 * i + 1] = c * y[i] - s * x[i];
		pose.world_from_camera[4 * i + 2] = z[i];
		pose.world_from_camera[4 * i + 3] = eye[i];
	}
	pose.world_from_camera[15] = 1;
	return pose;
}

struct dio_pose orbit(double azimuth_deg, double elevation_deg, double distance_m, double roll_deg)
{
	double azimuth = azimuth_deg * M_PI / 180, elevation = elevation_deg * M_PI / 180;
	const double eye[3] = {distance_m * cos(elevation) * cos(azimuth),
			       distance_m * cos(elevation) * sin(azimuth),
			       distance_m * sin(elevation)};
	const double centre[3] = {0, 0, 0};

	return look_at(eye, centre, roll_deg);
}

/* Inverse of the plumb-bob model by fixed-point iteration; mild distortion needs few rounds. */
static void undistort_pixel(const struct dio_camera_model *m, double u, double v, double ray[2])
{
	const double *d = m->dist;
	double xd = (u - m->cx) / m->fx, yd = (v - m->cy) / m->fy, x = xd, y = yd;

	for (int i = 0; i < 10; i++) {
		double r2 = x * x + y * y;
		double radial = 1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
		double tx = 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x);
		double ty = d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y;

		x = (xd - tx) / radial;
		y = (yd - ty) / radial;
	}
	ray[0] = x;
	ray[1] = y;
}

/* Grey of the board's plane at a world position, from the print. */
struct print {
	struct dio_picture picture;
	double pixel_m, width_m, height_m;
};

enum { PRINT_SQUARE_PX = 60, PRINT_MARGIN_PX = 30, FINE = 3 };

static double print_grey(const struct print *print, int64_t u, int64_t v)
{
	if (u < 0 || v < 0 || u >= print->picture.width || v >= print->picture.height)
		return 110;
	return print->picture.rgb[3 * ((size_t)v * print->picture.width + (size_t)u)];
}

/* Bilinear, so that an edge moves smoothly however it lies to the pixels of the picture. */
static double sample_print(const struct print *print, double x, double y)
{
	double u = (x + print->width_m / 2) / print->pixel_m - 0.5;
	double v = (print->height_m / 2 - y) / print->pixel_m - 0.5;
	double left = floor(fmax(-2, fmin(u, 1e6))), top = floor(fmax(-2, fmin(v, 1e6)));
	double a = fmax(0, fmin(u - left, 1)), b = fmax(0, fmin(v - top, 1));
	int64_t i = (int64_t)left, j = (int64_t)top;

	return (1 - b) * ((1 - a) * print_grey(print, i, j) + a * print_grey(print, i + 1, j)) +
	       b * ((1 - a) * print_grey(print, i, j + 1) + a * print_grey(print, i + 1, j + 1));
}

/* What a pinhole of no size sees at one point of the picture. */
static float sample_point(const struct print *print, const struct dio_camera_model *model,
			  const double *t, double u, double v)
{
	double ray[2], direction[3];

	undistort_pixel(model, u, v, ray);
	for (int k = 0; k < 3; k++)
		direction[k] = t[4 * k] * ray[0] + t[4 * k + 1] * ray[1] + t[4 * k + 2];
	double along = -t[11] / direction[2];
	if (!(along > 0))
		return 40;
	return (float)sample_print(print, t[3] + along * direction[0], t[7] + along * direction[1]);
}

/* One pixel from FINE x FINE points each, under a tent two pixels wide: as soft as a good lens. */
static double filter_pixel(const float *fine, uint32_t width, uint32_t height, uint32_t u,
			   uint32_t v)
{
	double sum = 0, weights = 0;

	for (int j = 1 - FINE; j < FINE; j++)
		for (int i = 1 - FINE; i < FINE; i++) {
			int64_t x = (int64_t)u * FINE + FINE / 2 + i;
			int64_t y = (int64_t)v * FINE + FINE / 2 + j;
			double weight = (FINE - abs(i)) * (FINE - abs(j));

			if (x < 0 || y < 0 || x >= (int64_t)width * FINE ||
			    y >= (int64_t)height * FINE)
				continue;
			sum += weight * fine[(size_t)y * width * FINE + (size_t)x];
			weights += weight;
		}
	return sum / weights;
}

void render_board(const struct dio_board *board, const struct dio_camera_model *model,
		  const struct dio_pose *pose, struct dio_picture *picture)
{
	struct print print = {.pixel_m = board->square_m / PRINT_SQUARE_PX};
	struct dio_error error = {""};
	uint32_t width = model->width, height = model->height;
	float *fine = calloc((size_t)width * FINE * height * FINE, sizeof(*fine));

	assert_non_null(fine);
	if (dio_board_draw(board, PRINT_SQUARE_PX, PRINT_MARGIN_PX, &print.picture, &error) !=
	    DIO_OK)
		fail_msg("%s", error.text);
	print.width_m = print.picture.width * print.pixel_m;
	print.height_m = print.picture.height * print.pixel_m;
	for (uint32_t y = 0; y < height * FINE; y++)
		for (uint32_t x = 0; x < width * FINE; x++)
			fine[(size_t)y * width * FINE + x] =
				sample_point(&print, model, pose->world_from_camera,
					     (x + 0.5) / FINE - 0.5, (y + 0.5) / FINE - 0.5);

	dio_picture_deinit(picture);
	assert_int_equal(dio_picture_init(picture, width, height), DIO_OK);
	for (uint32_t v = 0; v < height; v++)
		for (uint32_t u = 0; u < width; u++) {
			double grey = filter_pixel(fine, width, height, u, v);

			memset(picture->rgb + 3 * ((size_t)v * width + u), (int)(grey + 0.5), 3);
		}
	dio_picture_deinit(&print.picture);
	free(fine);
}

void project_corners(const struct dio_board *board, const struct dio_camera_model *model,
		     const struct dio_pose *pose, double sigma_px, uint64_t *seed,
		     struct dio_corners *corners)
{
	uint32_t capacity = board->cols * board->rows, count = 0;
	uint32_t cols = board->kind == DIO_BOARD_CHARUCO ? board->cols - 1 : board->cols;
	double first = board->kind == DIO_BOARD_CHARUCO ? 1 : 0;
	float(*projected)[2] = calloc(capacity, sizeof(*projected));

	dio_corners_deinit(corners);
	corners->ids = calloc(capacity, sizeof(*corners->ids));
	corners->image_px = calloc(capacity, sizeof(*corners->image_px));
	corners->board_m = calloc(capacity, sizeof(*corners->board_m));
	assert_true(projected && corners->ids && corners->image_px && corners->board_m);
	assert_int_equal(dio_pose_project_board(board, model, pose, projected, capacity, &count),
			 DIO_OK);
	for (uint32_t id = 0; id < count; id++) {
		uint32_t at = corners->count;
		double u = projected[id][0] + sigma_px * noise(seed);
		double v = projected[id][1] + sigma_px * noise(seed);

		if (u < 0 || v < 0 || u > model->width - 1 || v > model->height - 1)
			continue;
		corners->ids[at] = id;
		corners->image_px[at][0] = (float)u;
		corners->image_px[at][1] = (float)v;
		corners->board_m[at][0] = (first + id % cols) * board->square_m;
		corners->board_m[at][1] = (first + id / cols) * board->square_m;
		corners->count++;
	}
	corners->layout = DIO_LAYOUT_MODERN;
	free(projected);
}
