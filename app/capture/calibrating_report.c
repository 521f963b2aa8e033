#include <inttypes.h>
#include <stdio.h>

#include "capture/calibrating.h"
#include "core/json_out.h"

static const char *use_text(enum dio_view_use use)
{
	switch (use) {
	case DIO_VIEW_USED:
		return "used";
	case DIO_VIEW_NO_BOARD:
		return "no board";
	case DIO_VIEW_OUTLIER:
		return "removed";
	case DIO_VIEW_DUPLICATE:
		return "duplicate";
	}
	return "unknown";
}

/* One parameter with its name and its standard deviation. */
struct parameter {
	const char *name;
	double value, sigma;
	const char *unit;
	int digits;
};

#define PARAMETERS 9

static void list_parameters(const struct dio_calibration *c, struct parameter list[PARAMETERS])
{
	static const char *const DIST[] = {"k1", "k2", "p1", "p2", "k3"};

	list[0] = (struct parameter){"fx", c->model.fx, c->sigma_fx, " px", 3};
	list[1] = (struct parameter){"fy", c->model.fy, c->sigma_fy, " px", 3};
	list[2] = (struct parameter){"cx", c->model.cx, c->sigma_cx, " px", 3};
	list[3] = (struct parameter){"cy", c->model.cy, c->sigma_cy, " px", 3};
	for (int i = 0; i < 5; i++)
		list[4 + i] =
			(struct parameter){DIST[i], c->model.dist[i], c->sigma_dist[i], "", 6};
}

static void print_view(const char *name, const struct dio_calibration_view *view)
{
	printf("  %-24s %-10s %4u corners", name, use_text(view->use), view->corners);
	if (view->rms_px > 0)
		printf("  %7.3f px", view->rms_px);
	if (*view->reason)
		printf("  %s", view->reason);
	putchar('\n');
}

static void print_frames(const struct dio_board_views *views)
{
	char spec[128];

	dio_board_format(&views->board, spec, sizeof spec);
	printf("board     %s\n", spec);
	printf("pictures  %" PRIu64 " looked at", views->frames);
	if (views->without_board)
		printf(", %" PRIu64 " without the board", views->without_board);
	if (views->not_new)
		printf(", %" PRIu64 " too like one before", views->not_new);
	if (views->other_size)
		printf(", %" PRIu64 " of another size", views->other_size);
	if (views->unreadable)
		printf(", %" PRIu64 " unreadable", views->unreadable);
	putchar('\n');
}

void dio_calibrating_print(const struct dio_calibrating *result, bool refused)
{
	const struct dio_calibration *c = &result->calibration;
	struct parameter list[PARAMETERS];

	print_frames(&result->views);
	if (c->views) {
		printf("views     %u used of %u\n", c->views_used, c->views_total);
		for (uint32_t i = 0; i < c->views_total && i < result->views.count; i++)
			print_view(result->views.names[i], &c->views[i]);
	}
	if (c->coverage > 0)
		printf("coverage  %.0f %% of the picture, tilt %.1f degrees\n", c->coverage * 100,
		       c->tilt_deg);
	if (c->rms_px > 0)
		printf("error     %.3f px RMS, %.3f px held out\n", c->rms_px, c->heldout_rms_px);
	if (refused)
		return;
	printf("camera    %u x %u pixels\n", c->model.width, c->model.height);
	list_parameters(c, list);
	for (int i = 0; i < PARAMETERS; i++)
		printf("  %-3s %12.*f +- %.*f%s\n", list[i].name, list[i].digits, list[i].value,
		       list[i].digits, list[i].sigma, list[i].unit);
}

static void add_views(cJSON *root, const struct dio_calibrating *result)
{
	const struct dio_calibration *c = &result->calibration;
	cJSON *list = cJSON_AddArrayToObject(root, "views");

	for (uint32_t i = 0; c->views && i < c->views_total && i < result->views.count; i++) {
		cJSON *item = cJSON_CreateObject();

		dio_json_add_text(item, "name", result->views.names[i]);
		dio_json_add_text(item, "use", use_text(c->views[i].use));
		dio_json_add_number(item, "corners", c->views[i].corners, 0);
		dio_json_add_number(item, "rms_px", c->views[i].rms_px, 4);
		dio_json_add_text(item, "reason", c->views[i].reason);
		cJSON_AddItemToArray(list, item);
	}
}

static void add_answer(cJSON *root, const struct dio_calibration *c)
{
	struct parameter list[PARAMETERS];
	cJSON *sigma = cJSON_AddObjectToObject(root, "sigma");

	cJSON_AddItemToObject(root, "camera", dio_json_camera(&c->model));
	list_parameters(c, list);
	for (int i = 0; i < PARAMETERS; i++)
		dio_json_add_number(sigma, list[i].name, list[i].sigma, 6);
}

cJSON *dio_calibrating_json(const struct dio_calibrating *result, const char *refused)
{
	const struct dio_calibration *c = &result->calibration;
	struct dio_board board = dio_calibrating_get_board(result);
	cJSON *root = cJSON_CreateObject();
	char spec[128];

	if (!root)
		return NULL;
	dio_board_format(&board, spec, sizeof spec);
	dio_json_add_text(root, "status", refused ? "refused" : "ok");
	if (refused)
		dio_json_add_text(root, "reason", refused);
	dio_json_add_text(root, "board", spec);
	dio_json_add_number(root, "frames", (double)result->views.frames, 0);
	dio_json_add_number(root, "unreadable", (double)result->views.unreadable, 0);
	dio_json_add_number(root, "views_used", c->views_used, 0);
	dio_json_add_number(root, "views_total", c->views_total, 0);
	dio_json_add_number(root, "rms_px", c->rms_px, 4);
	dio_json_add_number(root, "heldout_rms_px", c->heldout_rms_px, 4);
	dio_json_add_number(root, "coverage", c->coverage, 4);
	dio_json_add_number(root, "tilt_deg", c->tilt_deg, 2);
	if (!refused)
		add_answer(root, c);
	add_views(root, result);
	return root;
}
