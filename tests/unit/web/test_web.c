/* The web page's server, by raw requests: what it gives, and what it refuses. */
#include "unit/app/fixture.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "web/web.h"

#define TOKEN      "0123456789abcdef0123456789abcdef"
#define AUTHORISED "Authorization: Bearer " TOKEN "\r\n"
#define TURNS      2000 /* of the loop until an answer must be there */

static struct dio_web *web;
static struct dio_error error;
static char last_word[32];
static double last_numbers[3];
static char answer[1 << 20];

static char *describe(void *context)
{
	(void)context;
	return strdup("{\"state\":\"idle\"}");
}

static enum dio_status act(void *context, const char *word, const double numbers[3],
			   struct dio_error *why)
{
	(void)context;
	snprintf(last_word, sizeof last_word, "%s", word);
	memcpy(last_numbers, numbers, sizeof last_numbers);
	if (strcmp(word, "play") == 0)
		return dio_fail(why, DIO_REFUSED, "no scene to play");
	return DIO_OK;
}

static bool get_picture(void *context, const uint8_t **bytes, size_t *size)
{
	(void)context;
	*bytes = (const uint8_t *)"JPEG";
	*size = 4;
	return true;
}

static const char *get_folder(void *context)
{
	(void)context;
	return fixture_path("capture");
}

static int set_up(void **state)
{
	struct dio_web_options options = {.address = "127.0.0.1",
					  .token = TOKEN,
					  .host = {NULL, describe, act, get_picture, get_folder}};

	if (fixture_setup(state) != 0)
		return -1;
	fixture_write("capture/scene.json", "{}");
	fixture_write("capture/images/001.png", "a picture");
	fixture_write("secret", "secret");
	return dio_web_open(&options, &web, &error) == DIO_OK ? 0 : -1;
}

static int tear_down(void **state)
{
	dio_web_close(web);
	return fixture_teardown(state);
}

static int connect_to(void)
{
	struct sockaddr_in address = {.sin_family = AF_INET,
				      .sin_port = htons(dio_web_get_port(web)),
				      .sin_addr = {htonl(INADDR_LOOPBACK)}};
	int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

	assert_true(fd >= 0);
	assert_int_equal(connect(fd, (struct sockaddr *)&address, sizeof address), 0);
	assert_int_equal(fcntl(fd, F_SETFL, O_NONBLOCK), 0);
	return fd;
}

/* Send bytes and read what comes until the server closes; its status code, 0: none. */
static int exchange(const char *request, size_t size)
{
	int fd = connect_to(), code = 0;
	size_t sent = 0, got = 0;

	for (int turn = 0; turn < TURNS; turn++) {
		struct pollfd fds[2] = {{.fd = fd, .events = POLLIN},
					{.fd = dio_web_get_fd(web), .events = POLLIN}};
		ssize_t n = 0;

		if (sent < size) {
			n = send(fd, request + sent, size - sent, MSG_NOSIGNAL);
			sent += n > 0 ? (size_t)n : 0;
			/* Closed on us: what it said before is still there. */
			if (n < 0 && errno != EAGAIN)
				sent = size;
		}
		dio_web_dispatch(web);
		n = recv(fd, answer + got, sizeof answer - 1 - got, 0);
		if (n == 0 || (n < 0 && errno != EAGAIN))
			break;
		got += n > 0 ? (size_t)n : 0;
		if (n < 0)
			poll(fds, 2, 10);
	}
	close(fd);
	answer[got] = '\0';
	sscanf(answer, "HTTP/1.1 %d", &code);
	return code;
}

/* One request, the connection closed behind it. */
static int ask(const char *method, const char *path, const char *headers, const char *body)
{
	static char request[1 << 16];
	int size = snprintf(request, sizeof request,
			    "%s %s HTTP/1.1\r\nHost: x\r\nConnection: close\r\n%s"
			    "Content-Length: %zu\r\n\r\n%s",
			    method, path, headers, strlen(body), body);

	return exchange(request, (size_t)size);
}

static void the_page_comes_without_a_token_and_with_its_headers(void **state)
{
	(void)state;
	assert_int_equal(ask("GET", "/", "", ""), 200);
	assert_non_null(strstr(answer, "<title>Diorama</title>"));
	assert_non_null(strstr(answer, "Content-Security-Policy: default-src 'none'"));
	assert_non_null(strstr(answer, "X-Content-Type-Options: nosniff"));
	assert_int_equal(ask("GET", "/page.js", "", ""), 200);
	assert_int_equal(ask("GET", "/page.css", "", ""), 200);
}

static void everything_else_wants_the_token(void **state)
{
	static const char *const WRONG[] = {
		"",
		"Authorization: Bearer \r\n",
		"Authorization: Bearer 0123456789abcdef0123456789abcdee\r\n",
		"Authorization: Bearer 0123456789abcdef\r\n",
		"Authorization: Bearer " TOKEN TOKEN "\r\n",
		"Authorization: Basic " TOKEN "\r\n",
		"Authorization: " TOKEN "\r\n",
	};
	static const char *const PATHS[] = {"/api/status", "/api/picture.jpg", "/api/scene.json",
					    "/nothing"};

	(void)state;
	for (size_t i = 0; i < sizeof WRONG / sizeof *WRONG; i++) {
		for (size_t k = 0; k < sizeof PATHS / sizeof *PATHS; k++)
			assert_int_equal(ask("GET", PATHS[k], WRONG[i], ""), 401);
		last_word[0] = '\0';
		assert_int_equal(ask("POST", "/api/cancel", WRONG[i], ""), 401);
		assert_string_equal(last_word, "");
	}
	assert_int_equal(ask("GET", "/api/status", AUTHORISED, ""), 200);
	assert_non_null(strstr(answer, "{\"state\":\"idle\"}"));
}

static void buttons_reach_the_box_and_refusals_come_back(void **state)
{
	(void)state;
	assert_int_equal(ask("POST", "/api/capture", AUTHORISED, ""), 200);
	assert_string_equal(last_word, "capture");
	assert_int_equal(ask("POST", "/api/play", AUTHORISED, ""), 409);
	assert_non_null(strstr(answer, "no scene to play"));
	assert_int_equal(ask("POST", "/api/turn", AUTHORISED,
			     "{\"azimuth\":0.5,\"elevation\":-1,\"notches\":2}"),
			 200);
	assert_true(last_numbers[0] == 0.5 && last_numbers[1] == -1 && last_numbers[2] == 2);
	assert_int_equal(ask("POST", "/api/turn", AUTHORISED, "{\"azimuth\":\"x\"}"), 400);
	assert_int_equal(ask("POST", "/api/turn", AUTHORISED, "{\"azimuth\":1e999}"), 400);
	assert_int_equal(ask("POST", "/api/turn", AUTHORISED, "no json"), 400);
	assert_int_equal(ask("POST", "/api/shutdown", AUTHORISED, ""), 404);
	assert_int_equal(ask("GET", "/api/capture", AUTHORISED, ""), 404);
	assert_int_equal(ask("DELETE", "/api/status", AUTHORISED, ""), 405);
}

static void files_are_given_by_their_names_alone(void **state)
{
	static const char *const TRICKS[] = {
		"/api/../secret",
		"/api/images/../../secret",
		"/api/images/001.png/../../../secret",
		"/api/images/%2e%2e/%2e%2e/secret",
		"/api/images/..%2f..%2fsecret",
		"/api/images/001.png%00",
		"/api/images/-1.png",
		"/api/images/0x1.png",
		"/api/images/1.png.png",
		"/api//etc/passwd",
		"//etc/passwd",
		"/api/",
		"/api",
		"/api/images/",
		"/api/scene.json/",
		"/page.js/../../secret",
	};

	(void)state;
	assert_int_equal(ask("GET", "/api/scene.json", AUTHORISED, ""), 200);
	assert_int_equal(ask("GET", "/api/images/001.png", AUTHORISED, ""), 200);
	assert_non_null(strstr(answer, "a picture"));
	assert_int_equal(ask("GET", "/api/images/002.png", AUTHORISED, ""), 404);
	assert_int_equal(ask("GET", "/api/scene.safetensors", AUTHORISED, ""), 404);
	for (size_t i = 0; i < sizeof TRICKS / sizeof *TRICKS; i++) {
		if (ask("GET", TRICKS[i], AUTHORISED, "") == 200)
			fail_msg("%s is answered", TRICKS[i]);
		assert_null(strstr(answer, "secret"));
	}
	/* A link in the place of a picture leads nowhere. */
	assert_int_equal(symlink(fixture_path("secret"), fixture_path("capture/images/003.png")),
			 0);
	assert_int_equal(ask("GET", "/api/images/003.png", AUTHORISED, ""), 404);
}

static void huge_requests_are_refused_and_the_server_goes_on(void **state)
{
	size_t size = 4u << 20;
	char *huge = malloc(size);
	char *body = malloc(8192);
	int length;

	(void)state;
	assert_non_null(huge);
	assert_non_null(body);
	memset(body, 'a', 8191);
	body[8191] = '\0';
	assert_int_equal(ask("POST", "/api/turn", AUTHORISED, body), 413);
	/* A path, a header, and a body announced, that never end. */
	memset(huge, 'a', size);
	memcpy(huge, "GET /", 5);
	assert_int_not_equal(exchange(huge, size), 200);
	memcpy(huge, "GET / HTTP/1.1\r\nX: ", 19);
	assert_int_not_equal(exchange(huge, size), 200);
	memset(huge, 'a', size);
	length = snprintf(huge, 256,
			  "POST /api/cancel HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" AUTHORISED
			  "Content-Length: %zu\r\n\r\n",
			  size);
	huge[length] = 'a';
	last_word[0] = '\0';
	exchange(huge, size);
	assert_string_equal(last_word, "");
	/* Rubbish, and nothing at all. */
	assert_int_not_equal(exchange("\x16\x03\x01\x02\x00\x01\r\n\r\n", 10), 200);
	close(connect_to());
	assert_int_equal(ask("GET", "/api/status", AUTHORISED, ""), 200);
	free(huge);
	free(body);
}

static void a_token_is_made_once_for_its_owner_alone(void **state)
{
	char *first = NULL, *second = NULL;
	struct stat about;

	(void)state;
	assert_int_equal(dio_web_read_token(fixture_path("token"), &first, &error), DIO_OK);
	assert_int_equal(strlen(first), 32);
	assert_int_equal(stat(fixture_path("token"), &about), 0);
	assert_int_equal(about.st_mode & 0777, 0600);
	assert_int_equal(dio_web_read_token(fixture_path("token"), &second, &error), DIO_OK);
	assert_string_equal(first, second);
	free(first);
	free(second);
	fixture_write("short", "abc\n");
	assert_int_equal(dio_web_read_token(fixture_path("short"), &first, &error), DIO_BAD_FILE);
	fixture_write("odd", "0123456789abcdef\r\nX-Header: 1\n");
	assert_int_equal(dio_web_read_token(fixture_path("odd"), &first, &error), DIO_BAD_FILE);
}

static void what_cannot_be_opened_is_said(void **state)
{
	struct dio_web_options options = {.address = "127.0.0.1",
					  .port = dio_web_get_port(web),
					  .token = TOKEN,
					  .host = {NULL, describe, act, get_picture, get_folder}};
	struct dio_web *other;

	(void)state;
	assert_int_equal(dio_web_open(&options, &other, &error), DIO_BUSY);
	assert_non_null(strstr(error.text, "127.0.0.1"));
	options.address = "localhost";
	assert_int_equal(dio_web_open(&options, &other, &error), DIO_BAD_ARG);
	options.address = "::1";
	options.port = 0;
	options.token = "short";
	assert_int_equal(dio_web_open(&options, &other, &error), DIO_BAD_ARG);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_page_comes_without_a_token_and_with_its_headers),
		cmocka_unit_test(everything_else_wants_the_token),
		cmocka_unit_test(buttons_reach_the_box_and_refusals_come_back),
		cmocka_unit_test(files_are_given_by_their_names_alone),
		cmocka_unit_test(huge_requests_are_refused_and_the_server_goes_on),
		cmocka_unit_test(a_token_is_made_once_for_its_owner_alone),
		cmocka_unit_test(what_cannot_be_opened_is_said),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
