#include "capture/board_views.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/log.h"
#include "core/progress.h"

#define CELLS DIO_BOARD_CELLS

/* A view is new when its corners lie this share of the picture's diagonal from where any view
 * before had them (root mean square over the corners both show). */
#define NEW_VIEW_SHARE 0.04

/* With fewer corners in common two views are taken as different. */
#define COMMON_MIN 6u

/* A stream's view needs enough corners to be of use. */
#define CORNERS_MIN 8u

/* What gathering one input needs. */
struct gathering {
	struct dio_input *input;
	const struct dio_gather_options *options;
	struct dio_board_detector *detector;
	struct dio_board_views *views;
	bool stream;
	uint64_t start_ns;
};

static void mark_cells(struct dio_board_views *views, const struct dio_corners *corners)
{
	uint32_t marked = 0;

	for (uint32_t i = 0; i < corners->count; i++) {
		int x = (int)(corners->image_px[i][0] / (float)views->width * CELLS);
		int y = (int)(corners->image_px[i][1] / (float)views->height * CELLS);

		if (x >= 0 && x < CELLS && y >= 0 && y < CELLS)
			views->cells[y * CELLS + x] = true;
	}
	for (int i = 0; i < CELLS * CELLS; i++)
		marked += views->cells[i];
	views->coverage = (double)marked / (CELLS * CELLS);
}

/* Root mean square distance of the corners that both show, pixels; infinite with too few. */
static double distance_px(const struct dio_corners *a, const struct dio_corners *b)
{
	double sum = 0;
	uint32_t common = 0;

	/* Both lists are in the order of the ids. */
	for (uint32_t i = 0, j = 0; i < a->count && j < b->count;) {
		if (a->ids[i] < b->ids[j]) {
			i++;
		} else if (a->ids[i] > b->ids[j]) {
			j++;
		} else {
			double dx = a->image_px[i][0] - b->image_px[j][0];
			double dy = a->image_px[i][1] - b->image_px[j][1];

			sum += dx * dx + dy * dy;
			common++;
			i++;
			j++;
		}
	}
	return common < COMMON_MIN ? INFINITY : sqrt(sum / common);
}

static bool is_new(const struct dio_board_views *views, const struct dio_corners *corners)
{
	double least = NEW_VIEW_SHARE * hypot(views->width, views->height);

	for (uint32_t i = 0; i < views->count; i++)
		if (distance_px(&views->corners[i], corners) < least)
			return false;
	return true;
}

/* Takes over the corners. */
static enum dio_status append(struct dio_board_views *views, const char *name,
			      struct dio_corners *corners, struct dio_error *error)
{
	if (views->count == views->capacity) {
		uint32_t capacity = views->capacity ? views->capacity * 2 : 32;
		char **names = realloc(views->names, capacity * sizeof *names);
		struct dio_corners *grown;

		if (names)
			views->names = names;
		grown = realloc(views->corners, capacity * sizeof *grown);
		if (grown)
			views->corners = grown;
		if (!names || !grown)
			return dio_fail(error, DIO_NO_MEM, "no memory for %u views", capacity);
		views->capacity = capacity;
	}
	views->names[views->count] = strdup(name);
	if (!views->names[views->count])
		return dio_fail(error, DIO_NO_MEM, "no memory for %u views", views->count + 1);
	views->corners[views->count++] = *corners;
	*corners = (struct dio_corners){0};
	return DIO_OK;
}

/* Keep the corners as a view. */
static enum dio_status take(struct dio_board_views *views, const char *name,
			    struct dio_corners *corners, struct dio_error *error)
{
	mark_cells(views, corners);
	return append(views, name, corners, error);
}

enum dio_status dio_board_views_offer(struct dio_board_views *views, const char *name,
				      struct dio_corners *corners, enum dio_board_offer *offer,
				      struct dio_error *error)
{
	views->frames++;
	if (corners->count < CORNERS_MIN) {
		views->without_board++;
		*offer = DIO_OFFER_NO_BOARD;
		return DIO_OK;
	}
	if (!is_new(views, corners)) {
		views->not_new++;
		*offer = DIO_OFFER_NOT_NEW;
		return DIO_OK;
	}
	*offer = DIO_OFFER_TAKEN;
	return take(views, name, corners, error);
}

/* Look at one picture. */
static enum dio_status look(struct gathering *g, const struct dio_picture *picture,
			    const char *name, struct dio_error *error)
{
	struct dio_board_views *views = g->views;
	struct dio_corners corners = {0};
	enum dio_board_offer offer;
	enum dio_status status;

	if (views->width == 0) {
		views->width = picture->width;
		views->height = picture->height;
	}
	if (picture->width != views->width || picture->height != views->height) {
		dio_log_warn("%s: %u x %u pixels, the others have %u x %u; it is left out", name,
			     picture->width, picture->height, views->width, views->height);
		views->frames++;
		views->other_size++;
		return DIO_OK;
	}
	status = dio_board_detect(g->detector, picture, &corners, error);
	if (status == DIO_OK && g->stream) {
		status = dio_board_views_offer(views, name, &corners, &offer, error);
	} else if (status == DIO_OK) {
		views->frames++;
		views->without_board += corners.count < CORNERS_MIN;
		status = take(views, name, &corners, error);
	}
	dio_corners_deinit(&corners);
	return status;
}

static bool is_enough(const struct gathering *g)
{
	const struct dio_board_views *views = g->views;

	return (views->count >= g->options->views && views->coverage >= g->options->coverage) ||
	       views->count >= 2 * g->options->views;
}

static double share_done(const struct gathering *g, const struct dio_input_frame *about)
{
	uint64_t length = dio_input_get_length(g->input);
	double by_count = (double)g->views->count / g->options->views;
	double by_coverage = g->views->coverage / fmax(g->options->coverage, 0.01);

	if (length > 0)
		return (double)(about->index + 1) / (double)length;
	return fmin(fmin(by_count, by_coverage), 1);
}

static enum dio_status look_at_all(struct gathering *g, struct dio_error *error)
{
	struct dio_picture picture = {0};
	struct dio_input_frame about;
	struct dio_progress progress;
	bool live = dio_input_get_kind(g->input) == DIO_INPUT_LIVE;
	enum dio_status status;

	dio_progress_init(&progress, "looking for the board");
	while ((status = dio_input_next(g->input, &picture, &about, error)) == DIO_OK) {
		if (g->start_ns == 0)
			g->start_ns = about.timestamp_ns;
		status = look(g, &picture, about.name, error);
		if (status != DIO_OK)
			break;
		dio_progress_update(&progress, share_done(g, &about));
		if (g->stream && is_enough(g))
			break;
		if (live && (double)(about.timestamp_ns - g->start_ns) * 1e-9 > g->options->seconds)
			break;
	}
	dio_progress_done(&progress);
	dio_picture_deinit(&picture);
	return status == DIO_END ? DIO_OK : status;
}

enum dio_status dio_board_views_gather(struct dio_input *input, const struct dio_board *board,
				       const struct dio_gather_options *options,
				       struct dio_board_views *views, struct dio_error *error)
{
	struct gathering g = {
		.input = input,
		.options = options,
		.views = views,
		.stream = dio_input_get_kind(input) != DIO_INPUT_PHOTOS,
	};
	enum dio_status status = dio_board_detector_create(board, &g.detector, error);

	if (status != DIO_OK)
		return status;
	status = look_at_all(&g, error);
	views->board = *dio_board_detector_get_board(g.detector);
	views->unreadable = dio_input_get_unreadable(input);
	dio_board_detector_destroy(g.detector);
	return status;
}

void dio_board_views_deinit(struct dio_board_views *views)
{
	for (uint32_t i = 0; i < views->count; i++) {
		free(views->names[i]);
		dio_corners_deinit(&views->corners[i]);
	}
	free(views->names);
	free(views->corners);
	*views = (struct dio_board_views){0};
}
