#include "core/options.h"

#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/log.h"
#include "core/session.h"

#define OPTIONS_MAX  40
#define FIRST_CODE   1000 /* getopt's value of option 0; above every short option's letter */
#define HELP_COLUMN  30
#define PATCH_MAX_PX 256

/* Tiers by name. Each allows itself and what is below it on its architecture. */
enum {
	UP_TO_SSE2 = DVSM_CPU_SCALAR | DVSM_CPU_SSE2,
	UP_TO_SSE4 = UP_TO_SSE2 | DVSM_CPU_SSE4,
	UP_TO_AVX2 = UP_TO_SSE4 | DVSM_CPU_AVX2,
	UP_TO_AVX_VNNI = UP_TO_AVX2 | DVSM_CPU_AVX_VNNI,
	UP_TO_AVX512 = UP_TO_AVX2 | DVSM_CPU_AVX512,
	UP_TO_VNNI = UP_TO_AVX512 | DVSM_CPU_VNNI,
	UP_TO_AVX512_BF16 = UP_TO_VNNI | DVSM_CPU_AVX512_BF16,
	UP_TO_AMX = UP_TO_AVX512_BF16 | DVSM_CPU_AMX_INT8 | DVSM_CPU_AMX_BF16,
	UP_TO_NEON = DVSM_CPU_SCALAR | DVSM_CPU_NEON,
	UP_TO_DOTPROD = UP_TO_NEON | DVSM_CPU_NEON_DOTPROD,
	UP_TO_I8MM = UP_TO_DOTPROD | DVSM_CPU_NEON_I8MM,
	UP_TO_NEON_BF16 = UP_TO_I8MM | DVSM_CPU_NEON_BF16,
};

static const struct {
	const char *name;
	uint32_t mask;
} TIERS[] = {
	{"auto", DVSM_CPU_ALL},   {"scalar", DVSM_CPU_SCALAR},   {"sse2", UP_TO_SSE2},
	{"sse4", UP_TO_SSE4},     {"avx2", UP_TO_AVX2},          {"avxvnni", UP_TO_AVX_VNNI},
	{"avx512", UP_TO_AVX512}, {"vnni", UP_TO_VNNI},          {"avx512bf16", UP_TO_AVX512_BF16},
	{"amx", UP_TO_AMX},       {"neon", UP_TO_NEON},          {"dotprod", UP_TO_DOTPROD},
	{"i8mm", UP_TO_I8MM},     {"neonbf16", UP_TO_NEON_BF16},
};

static void print_option(const char *name, const char *value, const char *help)
{
	int width = printf("  --%s%s%s", name, value ? " " : "", value ? value : "");

	if (width >= HELP_COLUMN - 1) {
		putchar('\n');
		width = 0;
	}
	printf("%*s", HELP_COLUMN - width, "");
	/* A help text may have several lines; the later ones line up under the first. */
	for (const char *at = help; *at; at++) {
		putchar(*at);
		if (*at == '\n')
			printf("%*s", HELP_COLUMN, "");
	}
	putchar('\n');
}

static void print_help(const struct dio_usage *usage)
{
	printf("diorama %s: %s\n\nusage: diorama %s", usage->command, usage->summary,
	       usage->command);
	for (size_t i = 0; i < usage->option_count; i++)
		if (usage->options[i].required)
			printf(" --%s %s", usage->options[i].name, usage->options[i].value);
	printf(" [options]%s%s\n\noptions:\n", *usage->arguments ? " " : "", usage->arguments);
	for (size_t i = 0; i < usage->option_count; i++)
		print_option(usage->options[i].name, usage->options[i].value,
			     usage->options[i].help);
	print_option("help", NULL, "this text");
	if (usage->details)
		printf("\n%s\n", usage->details);
}

static bool parse_number(const char *text, double *value)
{
	char *end;

	errno = 0;
	*value = strtod(text, &end);
	return end != text && *end == '\0' && errno == 0 && isfinite(*value);
}

static enum dio_options_result wrong_value(const struct dio_usage *usage,
					   const struct dio_option *option, const char *text,
					   const char *wanted)
{
	dio_log_error("%s: --%s %s: %s is wanted", usage->command, option->name, text, wanted);
	return DIO_OPTIONS_WRONG;
}

static enum dio_options_result set_number(const struct dio_usage *usage,
					  const struct dio_option *option, const char *text)
{
	char wanted[96];
	double value;
	bool whole = option->kind == DIO_OPTION_COUNT;

	if (parse_number(text, &value) && value >= option->min && value <= option->max &&
	    (!whole || value == floor(value))) {
		if (whole)
			*(uint32_t *)option->target = (uint32_t)value;
		else
			*(double *)option->target = value;
		return DIO_OPTIONS_RUN;
	}
	snprintf(wanted, sizeof wanted, "a %snumber from %g to %g", whole ? "whole " : "",
		 option->min, option->max);
	return wrong_value(usage, option, text, wanted);
}

static enum dio_options_result set_patch(const struct dio_usage *usage,
					 const struct dio_option *option, const char *text)
{
	double value = 0;

	if (strcmp(text, "auto") != 0 && (!parse_number(text, &value) || value != floor(value) ||
					  value < 1 || value > PATCH_MAX_PX))
		return wrong_value(usage, option, text, "auto or 1 to 256 pixels");
	*(uint32_t *)option->target = (uint32_t)value;
	return DIO_OPTIONS_RUN;
}

static enum dio_options_result set_tier(const struct dio_usage *usage,
					const struct dio_option *option, const char *text)
{
	char wanted[128];

	for (size_t i = 0; i < sizeof TIERS / sizeof *TIERS; i++) {
		if (strcmp(text, TIERS[i].name) != 0)
			continue;
		/* Falling back silently would time or test something else than what was asked. */
		if (i > 0 && (TIERS[i].mask & ~dvsm_cpu_detect()) != 0) {
			snprintf(wanted, sizeof wanted, "this CPU has no such tier; %s or lower",
				 dvsm_cpu_name(dvsm_cpu_detect()));
			return wrong_value(usage, option, text, wanted);
		}
		*(uint32_t *)option->target = TIERS[i].mask;
		return DIO_OPTIONS_RUN;
	}
	return wrong_value(
		usage, option, text,
		"auto, scalar, sse2, sse4, avx2, avxvnni, avx512, vnni, avx512bf16, amx, "
		"neon, dotprod, i8mm or neonbf16");
}

static enum dio_options_result set_precision(const struct dio_usage *usage,
					     const struct dio_option *option, const char *text)
{
	static const enum dvsm_precision ALL[] = {DVSM_PRECISION_F32, DVSM_PRECISION_BF16,
						  DVSM_PRECISION_FIXED};

	for (size_t i = 0; i < sizeof ALL / sizeof *ALL; i++) {
		if (strcmp(text, dvsm_precision_name(ALL[i])) != 0)
			continue;
		*(enum dvsm_precision *)option->target = ALL[i];
		return DIO_OPTIONS_RUN;
	}
	return wrong_value(usage, option, text, "f32, bf16 or fixed");
}

static enum dio_options_result set_deblock(const struct dio_usage *usage,
					   const struct dio_option *option, const char *text)
{
	static const char *const WORDS[] = {
		[DIO_DEBLOCK_AUTO] = "auto",
		[DIO_DEBLOCK_ON] = "on",
		[DIO_DEBLOCK_OFF] = "off",
	};

	for (size_t i = 0; i < sizeof WORDS / sizeof *WORDS; i++) {
		if (strcmp(text, WORDS[i]) != 0)
			continue;
		*(enum dio_deblock *)option->target = (enum dio_deblock)i;
		return DIO_OPTIONS_RUN;
	}
	return wrong_value(usage, option, text, "auto, on or off");
}

static enum dio_options_result set_option(const struct dio_usage *usage,
					  const struct dio_option *option, const char *text)
{
	switch (option->kind) {
	case DIO_OPTION_FLAG:
		*(bool *)option->target = true;
		return DIO_OPTIONS_RUN;
	case DIO_OPTION_TEXT:
		if (*text == '\0')
			return wrong_value(usage, option, "\"\"", option->value);
		*(const char **)option->target = text;
		return DIO_OPTIONS_RUN;
	case DIO_OPTION_COUNT:
	case DIO_OPTION_REAL:
		return set_number(usage, option, text);
	case DIO_OPTION_PATCH:
		return set_patch(usage, option, text);
	case DIO_OPTION_TIER:
		return set_tier(usage, option, text);
	case DIO_OPTION_ARITHMETIC:
		return set_precision(usage, option, text);
	case DIO_OPTION_DEBLOCK:
		return set_deblock(usage, option, text);
	}
	return DIO_OPTIONS_WRONG;
}

static enum dio_options_result check_complete(const struct dio_usage *usage, const bool *seen,
					      uint32_t arguments)
{
	for (size_t i = 0; i < usage->option_count; i++) {
		if (usage->options[i].required && !seen[i]) {
			dio_log_error("%s: --%s %s is missing; see diorama %s --help",
				      usage->command, usage->options[i].name,
				      usage->options[i].value, usage->command);
			return DIO_OPTIONS_WRONG;
		}
	}
	if (arguments < usage->min_arguments) {
		dio_log_error("%s: %s is missing; see diorama %s --help", usage->command,
			      usage->arguments, usage->command);
		return DIO_OPTIONS_WRONG;
	}
	return DIO_OPTIONS_RUN;
}

/* The text that getopt_long stopped at. */
static enum dio_options_result wrong_option(const struct dio_usage *usage, int kind, char **argv)
{
	const char *text = argv[optind - 1];

	if (kind == ':')
		dio_log_error("%s: %s: a value is missing; see diorama %s --help", usage->command,
			      text, usage->command);
	else
		dio_log_error("%s: %s: no such option, or one that takes no value; see diorama %s "
			      "--help",
			      usage->command, text, usage->command);
	return DIO_OPTIONS_WRONG;
}

enum dio_options_result dio_options_parse(const struct dio_usage *usage, int argc, char **argv,
					  char ***arguments, uint32_t *count)
{
	struct option table[OPTIONS_MAX + 2] = {0};
	bool seen[OPTIONS_MAX] = {false};
	size_t n = usage->option_count < OPTIONS_MAX ? usage->option_count : OPTIONS_MAX;
	enum dio_options_result result;
	int code;

	for (size_t i = 0; i < n; i++) {
		const struct dio_option *option = &usage->options[i];
		bool flag = option->kind == DIO_OPTION_FLAG;

		table[i] = (struct option){option->name, flag ? no_argument : required_argument,
					   NULL, FIRST_CODE + (int)i};
	}
	table[n] = (struct option){"help", no_argument, NULL, 'h'};

	optind = 0; /* glibc: start afresh */
	while ((code = getopt_long(argc, argv, ":h", table, NULL)) != -1) {
		if (code == 'h') {
			print_help(usage);
			return DIO_OPTIONS_HELP;
		}
		if (code < FIRST_CODE)
			return wrong_option(usage, code, argv);
		result = set_option(usage, &usage->options[code - FIRST_CODE], optarg);
		if (result != DIO_OPTIONS_RUN)
			return result;
		seen[code - FIRST_CODE] = true;
	}
	*arguments = argv + optind;
	*count = (uint32_t)(argc - optind);
	if (*count > usage->max_arguments) {
		dio_log_error("%s: %s: one argument too many; see diorama %s --help",
			      usage->command, argv[optind + (int)usage->max_arguments],
			      usage->command);
		return DIO_OPTIONS_WRONG;
	}
	return check_complete(usage, seen, *count);
}

int dio_options_exit_code(enum dio_options_result result)
{
	return result == DIO_OPTIONS_WRONG ? DIO_EXIT_USAGE : DIO_EXIT_OK;
}
