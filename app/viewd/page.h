/* The web page's side of the daemon. */
#ifndef DIO_VIEWD_PAGE_H
#define DIO_VIEWD_PAGE_H

#include <stdbool.h>
#include <stdint.h>
#include <systemd/sd-event.h>

#include "dio/frame.h"
#include "viewd/worker.h"
#include "web/web.h"

struct dio_viewd;

/** A picture on its way to JPEG; one at a time. */
struct dio_viewd_encode {
	struct dio_job job;
	bool busy;
	struct dio_picture picture;
	uint8_t *bytes;
	size_t size;
};

struct dio_viewd_page {
	struct dio_web *web;
	sd_event_source *source;
	uint64_t asked_ns; /* when somebody last asked for a picture */
	bool stale;        /* the picture shown is newer than `jpeg` */
	struct dio_viewd_encode encode;
	uint8_t *jpeg; /* the newest encoded */
	size_t jpeg_size;
};

/** Open it where the profile wants it and it is not open. */
enum dio_status dio_viewd_page_open(struct dio_viewd *viewd, struct dio_error *error);
void dio_viewd_page_close(struct dio_viewd *viewd);

/** For connections that time out; a few times a second. */
void dio_viewd_page_tick(struct dio_viewd *viewd);

#endif
