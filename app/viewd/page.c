#include "viewd/page.h"

#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/json_out.h"
#include "core/log.h"
#include "core/path.h"
#include "dio/clock.h"
#include "viewd/jobs.h"

static void add_capture(cJSON *root, const struct dio_viewd *viewd)
{
	cJSON *skipped = cJSON_AddObjectToObject(root, "skipped");
	cJSON *cells = cJSON_AddArrayToObject(root, "cells");

	for (int i = DIO_KEYFRAME_KEPT + 1; i < DIO_KEYFRAME_VERDICTS; i++)
		if (viewd->status.skipped[i] > 0)
			cJSON_AddNumberToObject(
				skipped, dio_keyframe_verdict_name((enum dio_keyframe_verdict)i),
				viewd->status.skipped[i]);
	for (int i = 0; i < DIO_BOARD_CELLS * DIO_BOARD_CELLS; i++)
		cJSON_AddItemToArray(cells, cJSON_CreateBool(viewd->gathered.cells[i]));
}

static char *describe(void *context)
{
	const struct dio_viewd *viewd = context;
	const struct dio_viewd_status *status = &viewd->status;
	cJSON *root = cJSON_CreateObject();
	char *printed, *text;

	dio_json_add_text(root, "state", dio_viewd_state_name(viewd->machine.state));
	dio_json_add_text(root, "message", status->message);
	cJSON_AddBoolToObject(root, "alarm", status->alarm);
	dio_json_add_text(root, "camera", status->camera);
	cJSON_AddBoolToObject(root, "calibrated", status->calibrated);
	dio_json_add_number(root, "board_views", status->gathered, 0);
	dio_json_add_number(root, "coverage", status->coverage, 3);
	dio_json_add_number(root, "views", status->views, 0);
	dio_json_add_number(root, "views_min", status->views_min, 0);
	dio_json_add_number(root, "views_max", status->views_max, 0);
	dio_json_add_text(root, "verdict", status->verdict);
	dio_json_add_number(root, "progress", status->progress, 3);
	cJSON_AddBoolToObject(root, "scene", status->scene);
	dio_json_add_text(root, "source", status->source);
	dio_json_add_number(root, "fps", status->fps, 1);
	dio_json_add_number(root, "latency_ms", status->latency_ms, 1);
	dio_json_add_number(root, "latency_p99_ms", status->latency_p99_ms, 1);
	dio_json_add_number(root, "render_ms", status->render_ms, 1);
	dio_json_add_number(root, "patch_px", status->patch_px, 0);
	add_capture(root, viewd);
	printed = cJSON_PrintUnformatted(root);
	cJSON_Delete(root);
	/* cJSON's memory need not be malloc's. */
	text = printed ? strdup(printed) : NULL;
	cJSON_free(printed);
	return text;
}

static enum dio_status act(void *context, const char *word, const double numbers[3],
			   struct dio_error *error)
{
	static const struct {
		const char *word;
		enum dio_action action;
	} ACTIONS[] = {
		{"calibrate", DIO_ACTION_CALIBRATE},     {"capture", DIO_ACTION_CAPTURE},
		{"reconstruct", DIO_ACTION_RECONSTRUCT}, {"play", DIO_ACTION_PLAY},
		{"cancel", DIO_ACTION_CANCEL},
	};
	struct dio_viewd *viewd = context;
	enum dio_status status;

	if (strcmp(word, "turn") == 0)
		return dio_viewd_turn(viewd, numbers[0], numbers[1], numbers[2], error);
	if (strcmp(word, "follow") == 0)
		return dio_viewd_follow(viewd, error);
	if (strcmp(word, "save") == 0) {
		status = dio_viewd_ask(viewd, DIO_ACTION_SAVE, error);
		if (status == DIO_OK)
			dio_viewd_save(viewd, "", NULL);
		return status;
	}
	for (size_t i = 0; i < sizeof ACTIONS / sizeof *ACTIONS; i++)
		if (strcmp(word, ACTIONS[i].word) == 0)
			return dio_viewd_ask(viewd, ACTIONS[i].action, error);
	return dio_fail(error, DIO_BAD_ARG, "%s: no such action", word);
}

static enum dio_status run_encode(struct dio_job *base, struct dio_error *error)
{
	struct dio_viewd_encode *encode = (struct dio_viewd_encode *)base;

	return dio_picture_encode("picture.jpg", &encode->picture, &encode->bytes, &encode->size,
				  error);
}

static void done_encode(struct dio_job *base)
{
	struct dio_viewd_encode *encode = (struct dio_viewd_encode *)base;
	struct dio_viewd *viewd = base->owner;

	encode->busy = false;
	if (base->status != DIO_OK)
		return;
	free(viewd->page.jpeg);
	viewd->page.jpeg = encode->bytes;
	viewd->page.jpeg_size = encode->size;
	encode->bytes = NULL;
}

/* Begin to encode what is shown now. */
static void encode_next(struct dio_viewd *viewd)
{
	struct dio_viewd_page *page = &viewd->page;
	const struct dio_picture *shown = dio_viewd_get_shown(viewd);

	if (!page->stale || page->encode.busy || !shown ||
	    !dio_viewd_copy_picture(shown, &page->encode.picture))
		return;
	page->stale = false;
	page->encode.busy = true;
	dio_viewd_post(viewd, viewd->screen, &page->encode.job, run_encode, done_encode);
}

static bool get_picture(void *context, const uint8_t **bytes, size_t *size)
{
	struct dio_viewd *viewd = context;
	bool was_watched = dio_viewd_page_is_watched(viewd);

	viewd->page.asked_ns = dio_clock_ns();
	if (!was_watched)
		dio_viewd_show(viewd);
	encode_next(viewd);
	*bytes = viewd->page.jpeg;
	*size = viewd->page.jpeg_size;
	return viewd->page.jpeg != NULL;
}

static const char *get_folder(void *context)
{
	const struct dio_viewd *viewd = context;

	return viewd->capture_folder;
}

static int on_web(sd_event_source *source, int fd, uint32_t events, void *context)
{
	(void)source;
	(void)fd;
	(void)events;
	dio_web_dispatch(context);
	return 0;
}

void dio_viewd_page_tick(struct dio_viewd *viewd)
{
	if (viewd->page.web)
		dio_web_dispatch(viewd->page.web);
}

static enum dio_status open_web(struct dio_viewd *viewd, const char *token_path,
				struct dio_error *error)
{
	const struct dio_profile_web *web = &viewd->profile->web;
	struct dio_web_options options = {
		.address = web->address,
		.port = (uint16_t)web->port,
		.host = {viewd, describe, act, get_picture, get_folder},
	};
	char *token = NULL;
	enum dio_status status = dio_web_read_token(token_path, &token, error);

	if (status != DIO_OK)
		return status;
	options.token = token;
	status = dio_web_open(&options, &viewd->page.web, error);
	free(token);
	if (status == DIO_OK)
		dio_log_note("web page: http://%s:%u/ with the token in %s", web->address,
			     web->port, token_path);
	return status;
}

enum dio_status dio_viewd_page_open(struct dio_viewd *viewd, struct dio_error *error)
{
	const char *named = viewd->profile->web.token_file;
	char *path =
		*named ? strdup(named) : dio_path_join(viewd->profile->paths.state, "web-token");
	enum dio_status status = path ? open_web(viewd, path, error)
				      : dio_fail(error, DIO_NO_MEM, "web page: no memory");

	free(path);
	if (status == DIO_OK &&
	    sd_event_add_io(viewd->loop, &viewd->page.source, dio_web_get_fd(viewd->page.web),
			    EPOLLIN, on_web, viewd->page.web) < 0) {
		dio_viewd_page_close(viewd);
		return dio_fail(error, DIO_IO, "web page: the event loop does not take it");
	}
	return status;
}

void dio_viewd_page_close(struct dio_viewd *viewd)
{
	struct dio_viewd_page *page = &viewd->page;

	sd_event_source_disable_unref(page->source);
	dio_web_close(page->web);
	dio_picture_deinit(&page->encode.picture);
	free(page->encode.bytes);
	free(page->jpeg);
	*page = (struct dio_viewd_page){0};
}
