/* Command-line options from one table: parsing over getopt_long and the text of --help. */
#ifndef DIO_APP_OPTIONS_H
#define DIO_APP_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum dio_option_kind {
	DIO_OPTION_FLAG,  /* no value; target is bool * */
	DIO_OPTION_TEXT,  /* target is const char **, borrowed from argv */
	DIO_OPTION_COUNT, /* whole number in [min, max]; target is uint32_t * */
	DIO_OPTION_REAL,  /* finite number in [min, max]; target is double * */
	DIO_OPTION_PATCH, /* "auto" (0) or 1..256 pixels; target is uint32_t * */
	DIO_OPTION_TIER,  /* an instruction-set tier as a dvsm_cpu mask; target is uint32_t * */
	DIO_OPTION_ARITHMETIC, /* "f32", "bf16", "fixed"; target is enum dvsm_precision * */
	DIO_OPTION_DEBLOCK,    /* "auto", "on", "off"; target is enum dio_deblock * */
};

/**
 * One option. The target keeps its value when the option is absent, so it holds the default.
 *
 * name      long name without dashes
 * value     what stands for the value in --help ("FILE"); NULL for a flag
 * required  absent: refused with the usage line
 */
struct dio_option {
	const char *name;
	enum dio_option_kind kind;
	const char *value;
	const char *help;
	void *target;
	double min, max;
	bool required;
};

/** A sub-command as --help shows it. --help and -h are understood without being listed. */
struct dio_usage {
	const char *command;   /* "reconstruct" */
	const char *summary;   /* one line */
	const char *arguments; /* positional arguments as shown, "INPUT"; "" for none */
	const char *details;   /* NULL, or further lines below the options */
	uint32_t min_arguments, max_arguments;
	const struct dio_option *options;
	size_t option_count;
};

enum dio_options_result {
	DIO_OPTIONS_RUN,   /* all good: go on */
	DIO_OPTIONS_HELP,  /* --help was printed: exit 0 */
	DIO_OPTIONS_WRONG, /* one line was printed: exit 2 */
};

/** Exit codes of every sub-command. */
enum dio_exit { DIO_EXIT_OK = 0, DIO_EXIT_FAILED = 1, DIO_EXIT_USAGE = 2 };

/**
 * Parse argv (argv[0] is the sub-command).
 *
 * arguments   receives the first positional argument's place in argv
 * count       receives how many there are
 */
enum dio_options_result dio_options_parse(const struct dio_usage *usage, int argc, char **argv,
					  char ***arguments, uint32_t *count);

/** Exit code for a result that is not DIO_OPTIONS_RUN. */
int dio_options_exit_code(enum dio_options_result result);

#endif
