/* What the files of app/web share. */
#ifndef DIO_WEB_WEB_PRIVATE_H
#define DIO_WEB_WEB_PRIVATE_H

#include <microhttpd.h>

#include "web/web.h"

/** Nothing that the page sends is longer. */
#define DIO_WEB_BODY_MAX 512u

struct dio_web {
	struct MHD_Daemon *daemon;
	struct dio_web_host host;
	char *token;
	int fd;
};

/** One request: what of its body came so far. */
struct dio_web_request {
	char body[DIO_WEB_BODY_MAX + 1];
	size_t size;
	bool too_long;
};

/** Queue the answer to a request whose body is complete. */
enum MHD_Result dio_web_answer(struct dio_web *web, struct MHD_Connection *connection,
			       const char *method, const char *url,
			       const struct dio_web_request *request);

/** Queue one line of text, as an answer that is no success. */
enum MHD_Result dio_web_answer_fault(struct MHD_Connection *connection, unsigned code,
				     const char *text);

#endif
