/* The program's face: help, wrong usage, and that outputs which fail are told. */
#include "unit/app/fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct fixture_run run;

/* The names in the list of `diorama --help`, one line "  NAME   what it does" each. */
static size_t list_commands(char names[][32], size_t room)
{
	char *at, *line;
	size_t count = 0;

	fixture_diorama(&run, "--help", NULL);
	assert_int_equal(run.code, 0);
	at = strstr(run.out, "commands:\n");
	assert_non_null(at);
	at += strlen("commands:\n");
	while ((line = strsep(&at, "\n")) && strncmp(line, "  ", 2) == 0) {
		assert_true(count < room);
		assert_int_equal(sscanf(line, "  %31s", names[count]), 1);
		count++;
	}
	return count;
}

static void every_command_explains_itself(void **state)
{
	char names[32][32];
	size_t count = list_commands(names, 32);

	(void)state;
	assert_true(count >= 10);
	for (size_t i = 0; i < count; i++) {
		char head[64];

		fixture_diorama(&run, names[i], "--help", NULL);
		assert_int_equal(run.code, 0);
		assert_string_equal(run.err, "");
		snprintf(head, sizeof head, "diorama %s", names[i]);
		if (strncmp(run.out, head, strlen(head)) != 0 || !strstr(run.out, "usage: ") ||
		    !strstr(run.out, "--help"))
			fail_msg("%s --help says: %s", names[i], run.out);
		for (const char *line = run.out; line; line = strchr(line, '\n')) {
			line += *line == '\n';
			if (strcspn(line, "\n") > 100)
				fail_msg("%s --help has a line over 100 columns: %.110s", names[i],
					 line);
		}
	}
}

static void every_command_refuses_an_option_it_does_not_have(void **state)
{
	char names[32][32];
	size_t count = list_commands(names, 32);

	(void)state;
	for (size_t i = 0; i < count; i++) {
		/* board has verbs of its own before its options */
		if (strcmp(names[i], "board") == 0)
			fixture_diorama(&run, "board", "print", "--no-such-option", NULL);
		else
			fixture_diorama(&run, names[i], "--no-such-option", NULL);
		fixture_expect_refusal(&run, 2, "--no-such-option");
		fixture_expect_refusal(&run, 2, names[i]);
	}
}

static void wrong_usage_is_told_in_one_line(void **state)
{
	(void)state;
	fixture_diorama(&run, NULL);
	fixture_expect_refusal(&run, 2, "command|--help");
	fixture_diorama(&run, "frobnicate", NULL);
	fixture_expect_refusal(&run, 2, "frobnicate|--help");
	fixture_diorama(&run, "reconstruct", "--scene", "x", NULL);
	fixture_expect_refusal(&run, 2, "--out FILE is missing");
	fixture_diorama(&run, "render", "--out", "x", NULL);
	fixture_expect_refusal(&run, 2, "--scene or --scene-cache");
	fixture_diorama(&run, "render", "--out", NULL);
	fixture_expect_refusal(&run, 2, "--out: a value is missing");
	fixture_diorama(&run, "info", NULL);
	fixture_expect_refusal(&run, 2, "FILE is missing");
	fixture_diorama(&run, "info", "a", "b", NULL);
	fixture_expect_refusal(&run, 2, "b: one argument too many");
	fixture_diorama(&run, "eval", "--scene", "x", "--threads", "many", NULL);
	fixture_expect_refusal(&run, 2, "--threads many|0 to 256");
}

static void files_of_no_known_kind_are_refused(void **state)
{
	(void)state;
	fixture_write("junk", "neither this nor that");
	fixture_diorama(&run, "info", fixture_path("junk"), NULL);
	fixture_expect_refusal(&run, 1, "junk|is not a model");
	fixture_diorama(&run, "info", fixture_path("nothing"), NULL);
	fixture_expect_refusal(&run, 1, "nothing|No such file");
	fixture_write("half.safetensors", "\x40\x01\x01\x01\x01\x01\x01\x01{\"a\":");
	fixture_diorama(&run, "info", fixture_path("half.safetensors"), NULL);
	fixture_expect_refusal(&run, 1, "half.safetensors");
}

static void a_full_standard_output_is_a_failure(void **state)
{
	const char *folder = getenv("DIO_BIN_DIR");
	char command[FIXTURE_PATH_SIZE];

	(void)state;
	snprintf(command, sizeof command, "exec %s/diorama --help > /dev/full", folder);
	fixture_program(&run, "sh", "-c", command, NULL);
	fixture_expect_refusal(&run, 1, "standard output");
}

static void a_window_without_a_display_is_refused(void **state)
{
	const char *model = fixture_shared("golden/tiny/model.safetensors");
	char model_path[FIXTURE_PATH_SIZE], command[3 * FIXTURE_PATH_SIZE];

	(void)state;
	if (!model)
		skip();
	snprintf(model_path, sizeof model_path, "%s", model);
	snprintf(
		command, sizeof command,
		"unset DISPLAY WAYLAND_DISPLAY; exec %s/diorama view --model %s %s 2>&1 >/dev/null "
		"| tail -n 1 >&2",
		getenv("DIO_BIN_DIR"), model_path, fixture_shared("golden/tiny/scene.json"));
	fixture_program(&run, "sh", "-c", command, NULL);
	fixture_expect_refusal(&run, 0, "display");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_command_explains_itself),
		cmocka_unit_test(every_command_refuses_an_option_it_does_not_have),
		cmocka_unit_test(wrong_usage_is_told_in_one_line),
		cmocka_unit_test(files_of_no_known_kind_are_refused),
		cmocka_unit_test(a_full_standard_output_is_a_failure),
		cmocka_unit_test(a_window_without_a_display_is_refused),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
