#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "system.h"

#define PATH_SIZE 64

/* What was looked at in vain, for the message. */
struct search {
	uint32_t chips;
	int refused; /* errno of a chip that could not be opened */
	char refused_path[PATH_SIZE];
};

static const char *file_name(const char *path)
{
	const char *slash = strrchr(path, '/');

	return slash ? slash + 1 : path;
}

static bool is_wanted_chip(const struct dio_gpio_system *system, void *chip, const char *path,
			   const struct dio_gpio_line *line)
{
	char label[DIO_GPIO_NAME_MAX];

	if (strcmp(line->chip, path) == 0 || strcmp(line->chip, file_name(path)) == 0)
		return true;
	system->get_label(system->context, chip, label, sizeof(label));
	return strcmp(line->chip, label) == 0;
}

/* The line's offset on this chip; -1: not here. */
static int look_at_chip(const struct dio_gpio_system *system, void *chip, const char *path,
			const struct dio_gpio_line *line)
{
	if (!line->chip[0])
		return system->find(system->context, chip, line->name);
	return is_wanted_chip(system, chip, path, line) ? (int)line->offset : -1;
}

static enum dio_status fail_search(const struct dio_gpio_line *line, const struct search *search,
				   struct dio_error *error)
{
	if (search->refused)
		return dio_fail(error, DIO_IO,
				"line %s%s: %s cannot be opened: %s; run as a member of group gpio",
				line->chip, line->name, search->refused_path,
				strerror(search->refused));
	if (search->chips == 0)
		return dio_fail(error, DIO_NOT_FOUND,
				"line %s%s: this machine has no GPIO chip (/dev/gpiochip*)",
				line->chip, line->name);
	if (line->chip[0])
		return dio_fail(error, DIO_NOT_FOUND,
				"line %s:%u: no GPIO chip has this name or label; gpiodetect "
				"lists them",
				line->chip, line->offset);
	return dio_fail(error, DIO_NOT_FOUND,
			"line %s: none of %u GPIO chips has a line of this name; gpioinfo lists "
			"them",
			line->name, search->chips);
}

/* The open chip that has the line, and the line's offset. */
static enum dio_status find(const struct dio_gpio_system *system, const struct dio_gpio_line *line,
			    void **chip, uint32_t *offset, struct dio_error *error)
{
	struct search search = {0};
	char path[PATH_SIZE];

	for (uint32_t i = 0; system->list(system->context, i, path, sizeof(path)); i++) {
		void *open;
		int found;

		search.chips++;
		if (system->open(system->context, path, &open) < 0) {
			search.refused = errno;
			snprintf(search.refused_path, sizeof(search.refused_path), "%s", path);
			continue;
		}
		found = look_at_chip(system, open, path, line);
		if (found >= 0 &&
		    (uint32_t)found >= system->get_line_count(system->context, open)) {
			dio_fail(error, DIO_NOT_FOUND, "line %s:%u: the chip has lines 0 to %u",
				 line->chip, line->offset,
				 system->get_line_count(system->context, open) - 1);
			system->close(system->context, open);
			return DIO_NOT_FOUND;
		}
		if (found >= 0) {
			*chip = open;
			*offset = (uint32_t)found;
			return DIO_OK;
		}
		system->close(system->context, open);
	}
	return fail_search(line, &search, error);
}

static enum dio_status fail_request(const struct dio_gpio_system *system, const char *owner,
				    const struct dio_gpio_line *line, void *chip, uint32_t offset,
				    int cause, struct dio_error *error)
{
	char consumer[DIO_GPIO_NAME_MAX] = "";
	char name[2 * DIO_GPIO_NAME_MAX];

	snprintf(name, sizeof(name), line->chip[0] ? "%s%s:%u" : "%s%s", line->chip, line->name,
		 offset);
	if (cause == EBUSY) {
		system->get_consumer(system->context, chip, offset, consumer, sizeof(consumer));
		return dio_fail(error, DIO_BUSY, "%s: line %s is in use by %s; end that first",
				owner, name, consumer[0] ? consumer : "another program");
	}
	if (cause == ENXIO || cause == ENOTTY)
		return dio_fail(error, DIO_UNSUPPORTED,
				"%s: line %s cannot report edges (it has no interrupt); choose "
				"another",
				owner, name);
	return dio_fail(error, dio_status_from_errno(cause), "%s: line %s cannot be taken: %s",
			owner, name, strerror(cause));
}

enum dio_status dio_gpio_hold(const struct dio_gpio_system *system, const char *owner,
			      const struct dio_gpio_line *line, struct dio_gpio_request *request,
			      struct dio_gpio_hold *hold, struct dio_error *error)
{
	struct dio_gpio_hold taken = {0};
	struct dio_error cause;
	enum dio_status status = find(system, line, &taken.chip, &request->offset, &cause);

	if (status != DIO_OK)
		return dio_fail(error, status, "%s: %.400s", owner, cause.text);
	if (system->request(system->context, taken.chip, request, &taken.line) < 0) {
		status = fail_request(system, owner, line, taken.chip, request->offset, errno,
				      error);
		system->close(system->context, taken.chip);
		return status;
	}
	*hold = taken;
	return DIO_OK;
}

void dio_gpio_let_go(const struct dio_gpio_system *system, struct dio_gpio_hold *hold)
{
	if (hold->line)
		system->release(system->context, hold->line);
	if (hold->chip)
		system->close(system->context, hold->chip);
	*hold = (struct dio_gpio_hold){0};
}

enum dio_status dio_gpio_line_check_on(const struct dio_gpio_system *system,
				       const struct dio_gpio_line *line, struct dio_error *error)
{
	void *chip;
	uint32_t offset;
	enum dio_status status = find(system, line, &chip, &offset, error);

	if (status == DIO_OK)
		system->close(system->context, chip);
	return status;
}

enum dio_status dio_gpio_line_check(const struct dio_gpio_line *line, struct dio_error *error)
{
	return dio_gpio_line_check_on(&dio_gpio_kernel, line, error);
}
