/* What each request is answered with. Paths are words of a list, never parts of a file's name. */
#include <cjson/cJSON.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "web/page.h"
#include "web/web_private.h"

static const char *const HEADERS[][2] = {
	{"Cache-Control", "no-store"},
	{"X-Content-Type-Options", "nosniff"},
	{"X-Frame-Options", "DENY"},
	{"Referrer-Policy", "no-referrer"},
	{"Content-Security-Policy",
	 "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
	 "connect-src 'self'; base-uri 'none'; form-action 'none'"},
};

static enum MHD_Result queue(struct MHD_Connection *connection, unsigned code, const char *type,
			     struct MHD_Response *response)
{
	enum MHD_Result result;

	if (!response)
		return MHD_NO;
	MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, type);
	for (size_t i = 0; i < sizeof HEADERS / sizeof *HEADERS; i++)
		MHD_add_response_header(response, HEADERS[i][0], HEADERS[i][1]);
	result = MHD_queue_response(connection, code, response);
	MHD_destroy_response(response);
	return result;
}

/* The server wants pointers to what it may write; told to copy or keep, it does not. */
static void *writable(const void *bytes)
{
	union {
		const void *from;
		void *to;
	} both = {bytes};

	return both.to;
}

static enum MHD_Result answer_bytes(struct MHD_Connection *connection, unsigned code,
				    const char *type, const void *bytes, size_t size,
				    enum MHD_ResponseMemoryMode mode)
{
	return queue(connection, code, type,
		     MHD_create_response_from_buffer(size, writable(bytes), mode));
}

static enum MHD_Result answer_json(struct MHD_Connection *connection, unsigned code, char *text)
{
	if (!text)
		return dio_web_answer_fault(connection, MHD_HTTP_INTERNAL_SERVER_ERROR,
					    "memory is short");
	return answer_bytes(connection, code, "application/json", text, strlen(text),
			    MHD_RESPMEM_MUST_FREE);
}

enum MHD_Result dio_web_answer_fault(struct MHD_Connection *connection, unsigned code,
				     const char *text)
{
	return answer_bytes(connection, code, "text/plain; charset=utf-8", text, strlen(text),
			    MHD_RESPMEM_MUST_COPY);
}

/* In a time that does not tell how much of it was right. */
static bool is_token(const char *given, const char *token)
{
	size_t length = strlen(token), given_length = strlen(given);
	unsigned char off = given_length != length;

	for (size_t i = 0; i < length; i++)
		off |= (unsigned char)(token[i] ^ given[given_length ? i % given_length : 0]);
	return off == 0;
}

static bool is_permitted(const struct dio_web *web, struct MHD_Connection *connection)
{
	static const char scheme[] = "Bearer ";
	const char *given =
		MHD_lookup_connection_value(connection, MHD_HEADER_KIND, "Authorization");

	return given && strncmp(given, scheme, sizeof scheme - 1) == 0 &&
	       is_token(given + sizeof scheme - 1, web->token);
}

static enum MHD_Result answer_page(struct MHD_Connection *connection, const char *url, bool *known)
{
	const struct {
		const char *url, *type;
		const uint8_t *bytes;
		size_t size;
	} FILES[] = {
		{"/", "text/html; charset=utf-8", dio_page_index_html, dio_page_index_html_size},
		{"/page.css", "text/css; charset=utf-8", dio_page_page_css, dio_page_page_css_size},
		{"/page.js", "text/javascript; charset=utf-8", dio_page_page_js,
		 dio_page_page_js_size},
	};

	*known = true;
	for (size_t i = 0; i < sizeof FILES / sizeof *FILES; i++)
		if (strcmp(url, FILES[i].url) == 0)
			return answer_bytes(connection, MHD_HTTP_OK, FILES[i].type, FILES[i].bytes,
					    FILES[i].size, MHD_RESPMEM_PERSISTENT);
	*known = false;
	return MHD_NO;
}

/* A file of the capture. `name` is one of ours: nothing of the request goes into it but a number.
 */
static enum MHD_Result answer_file(struct dio_web *web, struct MHD_Connection *connection,
				   const char *name, const char *type)
{
	const char *folder = web->host.get_folder(web->host.context);
	struct stat about;
	char path[4096];
	int fd = -1;

	if (folder && snprintf(path, sizeof path, "%s/%s", folder, name) < (int)sizeof path)
		fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
	if (fd < 0 || fstat(fd, &about) != 0 || !S_ISREG(about.st_mode)) {
		if (fd >= 0)
			close(fd);
		return dio_web_answer_fault(connection, MHD_HTTP_NOT_FOUND, "there is none yet");
	}
	/* The server closes it. */
	return queue(connection, MHD_HTTP_OK, type,
		     MHD_create_response_from_fd((size_t)about.st_size, fd));
}

static enum MHD_Result answer_get(struct dio_web *web, struct MHD_Connection *connection,
				  const char *word)
{
	const uint8_t *bytes;
	unsigned number;
	char name[32];
	size_t size;
	int end = 0;

	if (strcmp(word, "status") == 0)
		return answer_json(connection, MHD_HTTP_OK, web->host.describe(web->host.context));
	if (strcmp(word, "picture.jpg") == 0) {
		if (!web->host.get_picture(web->host.context, &bytes, &size))
			return dio_web_answer_fault(connection, MHD_HTTP_NOT_FOUND,
						    "there is no picture yet");
		return answer_bytes(connection, MHD_HTTP_OK, "image/jpeg", bytes, size,
				    MHD_RESPMEM_MUST_COPY);
	}
	if (strcmp(word, "scene.json") == 0)
		return answer_file(web, connection, "scene.json", "application/json");
	if (strcmp(word, "scene.safetensors") == 0)
		return answer_file(web, connection, "scene.safetensors",
				   "application/octet-stream");
	if (sscanf(word, "images/%6u.png%n", &number, &end) == 1 && end > 0 && !word[end]) {
		snprintf(name, sizeof name, "images/%03u.png", number);
		return answer_file(web, connection, name, "image/png");
	}
	return dio_web_answer_fault(connection, MHD_HTTP_NOT_FOUND, "no such thing");
}

/* {"azimuth": a, "elevation": b, "notches": c}; what is left out is 0. */
static bool read_numbers(const struct dio_web_request *request, double numbers[3])
{
	static const char *const KEYS[3] = {"azimuth", "elevation", "notches"};
	cJSON *root = cJSON_ParseWithLength(request->body, request->size);
	bool good = cJSON_IsObject(root);

	for (int i = 0; i < 3; i++) {
		const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, KEYS[i]);

		numbers[i] = cJSON_IsNumber(item) ? item->valuedouble : 0;
		good = good && (!item || cJSON_IsNumber(item)) && isfinite(numbers[i]);
	}
	cJSON_Delete(root);
	return good;
}

static enum MHD_Result answer_post(struct dio_web *web, struct MHD_Connection *connection,
				   const char *word, const struct dio_web_request *request)
{
	static const char *const WORDS[] = {"calibrate", "capture", "reconstruct", "play",
					    "save",      "cancel",  "follow",      "turn"};
	double numbers[3] = {0};
	struct dio_error why = {""};
	bool known = false;

	for (size_t i = 0; i < sizeof WORDS / sizeof *WORDS; i++)
		known = known || strcmp(word, WORDS[i]) == 0;
	if (!known)
		return dio_web_answer_fault(connection, MHD_HTTP_NOT_FOUND, "no such thing");
	if (strcmp(word, "turn") == 0 && !read_numbers(request, numbers))
		return dio_web_answer_fault(connection, MHD_HTTP_BAD_REQUEST,
					    "azimuth, elevation and notches are numbers");
	if (web->host.act(web->host.context, word, numbers, &why) != DIO_OK)
		return dio_web_answer_fault(connection, MHD_HTTP_CONFLICT, why.text);
	return answer_json(connection, MHD_HTTP_OK, strdup("{}"));
}

enum MHD_Result dio_web_answer(struct dio_web *web, struct MHD_Connection *connection,
			       const char *method, const char *url,
			       const struct dio_web_request *request)
{
	static const char prefix[] = "/api/";
	bool is_get = strcmp(method, MHD_HTTP_METHOD_GET) == 0;
	bool is_post = strcmp(method, MHD_HTTP_METHOD_POST) == 0;
	enum MHD_Result result;
	bool known;

	if (!is_get && !is_post)
		return dio_web_answer_fault(connection, MHD_HTTP_METHOD_NOT_ALLOWED,
					    "GET and POST alone are understood");
	if (is_get) {
		/* The page itself holds nothing of the box; all else wants the token. */
		result = answer_page(connection, url, &known);
		if (known)
			return result;
	}
	if (!is_permitted(web, connection))
		return dio_web_answer_fault(connection, MHD_HTTP_UNAUTHORIZED,
					    "the token is wrong or missing");
	if (strncmp(url, prefix, sizeof prefix - 1) != 0)
		return dio_web_answer_fault(connection, MHD_HTTP_NOT_FOUND, "no such thing");
	return is_get ? answer_get(web, connection, url + sizeof prefix - 1)
		      : answer_post(web, connection, url + sizeof prefix - 1, request);
}
