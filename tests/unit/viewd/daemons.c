#include "unit/viewd/daemons.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dio/camera.h"
#include "support/private_bus.h"
#include "support/random_model.h"

#define BOARD        "charuco:6x5:0.045:0.032:DICT_6X6_250"
#define DANCE_FRAMES 36u
#define WALK_FRAMES  40u

static struct support_private_bus bus;
static pid_t viewer, camera;
static unsigned port; /* of the web page */

/* Pictures of the simulated table, as files: a daemon then needs no time to trace rays. */
static void render_pictures(const char *style, const char *rate, uint32_t count)
{
	const struct dio_camera_options options = {.as_fast_as_possible = true,
						   .every_frame = true};
	struct dio_picture picture = {0};
	struct dio_camera *sim = NULL;
	struct dio_error error = {0};
	struct dio_frame frame;
	char spec[256], name[64];

	snprintf(spec, sizeof spec,
		 "sim:table?seed=7&width=320&height=240&samples=1&board=%s&style=%s&fps=%s", BOARD,
		 style, rate);
	if (dio_camera_open(spec, &options, &sim, &error) != DIO_OK ||
	    dio_camera_start(sim, &error) != DIO_OK)
		fail_msg("%s", error.text);
	for (uint32_t i = 0; i < count; i++) {
		assert_int_equal(dio_camera_acquire(sim, &frame, 1000000000, &error), DIO_OK);
		assert_int_equal(dio_frame_to_rgb(&frame, &picture, &error), DIO_OK);
		snprintf(name, sizeof name, "%s/%03u.png", style, i);
		if (i == 0)
			mkdir(fixture_path(style), 0777);
		if (dio_picture_write(fixture_path(name), &picture, &error) != DIO_OK)
			fail_msg("%s", error.text);
	}
	dio_picture_deinit(&picture);
	dio_camera_close(sim);
}

static void write_model(void)
{
	const struct dvsm_model_config config = {.dim = 32,
						 .heads = 4,
						 .layers = 2,
						 .patch_px = 8,
						 .mlp_ratio = 4,
						 .norm_eps = 1e-6};
	struct support_random random = {1};
	size_t size;
	unsigned char *bytes = support_random_model_file(&config, &random, &size);
	FILE *file = fopen(fixture_path("tiny.safetensors"), "wb");

	assert_non_null(bytes);
	assert_non_null(file);
	assert_int_equal(fwrite(bytes, 1, size, file), size);
	assert_int_equal(fclose(file), 0);
	free(bytes);
	fixture_write("tiny.json", "{\"deblock\": true}");
}

/* One that nobody has now. */
static unsigned find_port(void)
{
	struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}};
	socklen_t size = sizeof address;
	int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

	assert_true(fd >= 0);
	assert_int_equal(bind(fd, (struct sockaddr *)&address, size), 0);
	assert_int_equal(getsockname(fd, (struct sockaddr *)&address, &size), 0);
	close(fd);
	return ntohs(address.sin_port);
}

void daemons_write_profile(uint32_t reserve_mib, const char *deblock)
{
	char text[4096];

	snprintf(text, sizeof text,
		 "[camera]\nsource = replay:%s\nlock = no\n"
		 "[capture]\nboard = %s\nviews_min = 3\nviews_max = 5\nreserve_mib = %u\n"
		 "[display]\noutput = none\nmode = 320x240\nframes_per_second = 30\n"
		 "[engine]\nmodel = %s\nrender_width = 64\nrender_height = 48\nthreads = 1\n"
		 "patch_recon = 8\npatch_render = 8\ndeblock = %s\n"
		 "[paths]\nstate = %s\nruntime = %s\n"
		 "[web]\nenabled = yes\nport = %u\n",
		 fixture_path("walk"), BOARD, reserve_mib, fixture_path("tiny.safetensors"),
		 deblock, fixture_path("state"), fixture_path("run"), port);
	fixture_write("board.ini", text);
}

int daemons_setup(void **state)
{
	if (fixture_setup(state) != 0 || !support_private_bus_start(&bus))
		return -1;
	mkdir(fixture_path("run"), 0777);
	render_pictures("dance", "0.66667", DANCE_FRAMES);
	render_pictures("walk", "1", WALK_FRAMES);
	write_model();
	port = find_port();
	daemons_write_profile(1, "auto");
	return 0;
}

int daemons_teardown(void **state)
{
	daemons_stop_camera();
	if (viewer > 0)
		daemons_stop_viewer(SIGKILL);
	support_private_bus_stop(&bus);
	return fixture_teardown(state);
}

/* A daemon of the build; what it prints goes behind what is in `log`. */
static pid_t start(const char *program, const char *log, const char *const *options)
{
	const char *folder = getenv("DIO_BIN_DIR"), *log_path = fixture_path(log);
	const char *arguments[12] = {0};
	char path[FIXTURE_PATH_SIZE];
	int count = 0, fd;
	pid_t child;

	assert_non_null(folder);
	snprintf(path, sizeof path, "%s/%s", folder, program);
	arguments[count++] = path;
	while (*options)
		arguments[count++] = *options++;
	fflush(NULL);
	child = fork();
	assert_true(child >= 0);
	if (child != 0)
		return child;
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	fd = open(log_path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
	dup2(fd, STDERR_FILENO);
	/* execv() takes pointers to char for history's sake; it does not write. */
	execv(path, (char *const *)(uintptr_t)arguments);
	_exit(127);
}

static int end(pid_t *child, int signal_number)
{
	int status;

	kill(*child, signal_number);
	assert_int_equal(waitpid(*child, &status, 0), *child);
	*child = 0;
	return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

pid_t daemons_start_source(const char *source, double frames_per_second)
{
	char rate[32];

	daemons_stop_camera();
	snprintf(rate, sizeof rate, "%g", frames_per_second);
	camera = start("diorama-captured", "captured.log",
		       (const char *const[]){"--profile", fixture_path("board.ini"), "--camera",
					     source, "--fps", rate, NULL});
	return camera;
}

void daemons_start_camera(const char *pictures, double frames_per_second)
{
	char spec[FIXTURE_PATH_SIZE + 16];

	snprintf(spec, sizeof spec, "replay:%s", fixture_path(pictures));
	daemons_start_source(spec, frames_per_second);
}

void daemons_stop_camera(void)
{
	if (camera > 0)
		end(&camera, SIGTERM);
}

void daemons_start_viewer(void)
{
	viewer = start("diorama-viewd", "viewd.log",
		       (const char *const[]){"--profile", fixture_path("board.ini"), NULL});
	/* The bus knows it once it answers; until then waiting fails at once. */
	for (int tries = 0; tries < 400; tries++) {
		struct fixture_run run;

		fixture_diorama(&run, "ctl", "wait", "ViewsMin=3", NULL);
		if (run.code == 0)
			return;
		if (waitpid(viewer, NULL, WNOHANG) != 0)
			break;
		usleep(50000);
	}
	fail_msg("the display daemon does not come up: %s", daemons_read_log());
}

int daemons_stop_viewer(int signal_number)
{
	return end(&viewer, signal_number);
}

void daemons_end_viewer(int signal_number)
{
	int status = daemons_stop_viewer(signal_number);

	if (status == 0)
		return;
	/* A sanitizer says more than a message of the test may be long. */
	fprintf(stderr, "%s\n", daemons_read_log());
	fail_msg("the display daemon ends with %d", status);
}

pid_t daemons_get_viewer(void)
{
	return viewer;
}

void daemons_ctl(const char *word, const char *argument)
{
	struct fixture_run run;

	fixture_diorama(&run, "ctl", word, argument, NULL);
	if (run.code != 0)
		fail_msg("ctl %s: %s", word, run.err);
}

void daemons_wait(const char *condition)
{
	struct fixture_run run;

	fixture_diorama(&run, "ctl", "--timeout", "60", "wait", condition, NULL);
	if (run.code != 0)
		fail_msg("%s\n%s", run.err, daemons_read_log());
}

void daemons_expect_refusal(const char *word, const char *words)
{
	struct fixture_run run;

	fixture_diorama(&run, "ctl", word, NULL);
	fixture_expect_refusal(&run, 1, words);
}

static const char *get(const char *daemon, const char *property)
{
	static char value[512];
	struct fixture_run run;
	char key[64], *at, *section;

	fixture_diorama(&run, "ctl", "status", NULL);
	snprintf(key, sizeof key, "\n  %s ", property);
	section = strstr(run.out, daemon);
	at = section ? strstr(section, key) : NULL;
	if (!at)
		fail_msg("%s is not in: %s%s", property, run.out, run.err);
	at += strlen(key);
	at += strspn(at, " ");
	snprintf(value, sizeof value, "%.*s", (int)strcspn(at, "\n"), at);
	return value;
}

const char *daemons_get(const char *property)
{
	return get("diorama-viewd", property);
}

const char *daemons_get_capture(const char *property)
{
	return get("diorama-captured", property);
}

const char *daemons_get_page(void)
{
	static char url[128];
	FILE *file = fopen(fixture_path("state/web-token"), "rb");
	char token[64] = "";

	assert_non_null(file);
	assert_int_equal(fscanf(file, "%63s", token), 1);
	fclose(file);
	snprintf(url, sizeof url, "http://127.0.0.1:%u/#%s", port, token);
	return url;
}

const char *daemons_read_log(void)
{
	static char text[16384];
	FILE *file = fopen(fixture_path("viewd.log"), "rb");
	size_t used;

	/* Its end, if it is long. */
	if (file)
		fseek(file, -(long)(sizeof text - 1), SEEK_END);
	used = file ? fread(text, 1, sizeof text - 1, file) : 0;

	text[used] = '\0';
	if (file)
		fclose(file);
	return text;
}
