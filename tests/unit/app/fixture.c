#include "unit/app/fixture.h"

#include <errno.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dio/frame.h"

#define ARGUMENTS_MAX 40
#define PATH_RING     16

static char scratch[512];

int fixture_setup(void **state)
{
	const char *base = getenv("TMPDIR");

	(void)state;
	snprintf(scratch, sizeof scratch, "%s/diorama-app-XXXXXX", base ? base : "/tmp");
	return mkdtemp(scratch) ? 0 : -1;
}

static int remove_entry(const char *path, const struct stat *about, int kind, struct FTW *ftw)
{
	(void)about;
	(void)kind;
	(void)ftw;
	return remove(path);
}

int fixture_teardown(void **state)
{
	(void)state;
	return nftw(scratch, remove_entry, 16, FTW_DEPTH | FTW_PHYS | FTW_MOUNT);
}

const char *fixture_path(const char *name)
{
	static char ring[PATH_RING][FIXTURE_PATH_SIZE];
	static unsigned next;
	char *path = ring[next++ % PATH_RING];

	snprintf(path, FIXTURE_PATH_SIZE, "%s/%s", scratch, name);
	return path;
}

static void make_folders(const char *path)
{
	char part[FIXTURE_PATH_SIZE];

	snprintf(part, sizeof part, "%s", path);
	for (char *at = part + 1; *at; at++) {
		if (*at != '/')
			continue;
		*at = '\0';
		if (mkdir(part, 0777) != 0)
			assert_int_equal(errno, EEXIST);
		*at = '/';
	}
}

void fixture_write(const char *name, const char *text)
{
	const char *path = fixture_path(name);
	FILE *file;

	make_folders(path);
	file = fopen(path, "wb");
	assert_non_null(file);
	assert_int_equal(fwrite(text, 1, strlen(text), file), strlen(text));
	assert_int_equal(fclose(file), 0);
}

void fixture_write_picture(const char *name, uint32_t width, uint32_t height)
{
	const char *path = fixture_path(name);
	struct dio_picture picture = {0};
	struct dio_error error = {0};

	make_folders(path);
	assert_int_equal(dio_picture_init(&picture, width, height), DIO_OK);
	for (uint32_t y = 0; y < height; y++)
		for (uint32_t x = 0; x < width; x++) {
			uint8_t *rgb = picture.rgb + 3 * ((size_t)y * width + x);

			rgb[0] = (uint8_t)(255 * x / width);
			rgb[1] = (uint8_t)(255 * y / height);
			rgb[2] = 128;
		}
	if (dio_picture_write(path, &picture, &error) != DIO_OK)
		fail_msg("%s", error.text);
	dio_picture_deinit(&picture);
}

const char *fixture_shared(const char *name)
{
	static char path[FIXTURE_PATH_SIZE];
	const char *shared = getenv("DIO_SHARED_DIR");

	snprintf(path, sizeof path, "%s/%s", shared ? shared : "", name);
	if (shared && access(path, R_OK) == 0)
		return path;
	printf("skipped: %s is not there (DIO_SHARED_DIR)\n", path);
	return NULL;
}

static void read_back(FILE *file, char *text, size_t size)
{
	size_t used;

	rewind(file);
	used = fread(text, 1, size - 1, file);
	text[used] = '\0';
	fclose(file);
}

/* Outputs go through files, so that neither can fill a pipe and stall the program. */
static void run_list(struct fixture_run *run, const char *program, const char **arguments)
{
	FILE *out = tmpfile(), *err = tmpfile();
	int status;
	pid_t child;

	assert_non_null(out);
	assert_non_null(err);
	fflush(NULL);
	child = fork();
	assert_true(child >= 0);
	if (child == 0) {
		dup2(fileno(out), STDOUT_FILENO);
		dup2(fileno(err), STDERR_FILENO);
		/* execvp() takes pointers to char for history's sake; it does not write. */
		execvp(program, (char *const *)(uintptr_t)arguments);
		_exit(127);
	}
	assert_int_equal(waitpid(child, &status, 0), child);
	run->code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
	read_back(out, run->out, sizeof run->out);
	read_back(err, run->err, sizeof run->err);
}

static void collect(const char **arguments, const char *first, va_list list)
{
	int count = 0;

	arguments[count++] = first;
	while ((arguments[count] = va_arg(list, const char *)) != NULL) {
		count++;
		assert_true(count < ARGUMENTS_MAX);
	}
}

void fixture_diorama(struct fixture_run *run, ...)
{
	const char *arguments[ARGUMENTS_MAX], *folder = getenv("DIO_BIN_DIR");
	char program[FIXTURE_PATH_SIZE];
	va_list list;

	assert_non_null(folder);
	snprintf(program, sizeof program, "%s/diorama", folder);
	va_start(list, run);
	collect(arguments, program, list);
	va_end(list);
	run_list(run, program, arguments);
}

void fixture_program(struct fixture_run *run, const char *program, ...)
{
	const char *arguments[ARGUMENTS_MAX];
	va_list list;

	va_start(list, program);
	collect(arguments, program, list);
	va_end(list);
	run_list(run, program, arguments);
}

/* `words` are separated by '|'. */
void fixture_expect_refusal(const struct fixture_run *run, int code, const char *words)
{
	char copy[512], *rest = copy, *word;
	const char *line = run->err, *end;

	/* A line that tells which model runs may come before. */
	if (strncmp(line, "diorama: model ", 15) == 0 && strchr(line, '\n'))
		line = strchr(line, '\n') + 1;
	end = strchr(line, '\n');
	if (run->code != code)
		fail_msg("exit code %d instead of %d; said: %s", run->code, code, run->err);
	if (!end || end[1] != '\0')
		fail_msg("not one line: %s", run->err);
	snprintf(copy, sizeof copy, "%s", words);
	while ((word = strsep(&rest, "|")))
		if (!strstr(line, word))
			fail_msg("\"%s\" is not in: %s", word, line);
}
