/* Which card to take. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "kms.h"

struct search {
	const struct dio_kms_system *system;
	const struct dio_kms_wish *wish;
	struct dio_kms_outputs *outputs;
	void *card;
	char path[64]; /* of the card looked at last */
	uint32_t cards;
	int cause; /* errno of the last that could not be opened */
};

bool dio_kms_is_refused(int cause)
{
	return cause == EACCES || cause == EPERM;
}

static bool has_connector(const struct dio_kms_outputs *outputs, const char *name)
{
	for (uint32_t i = 0; i < outputs->connector_count; i++)
		if (!name[0] || strcmp(outputs->connectors[i].name, name) == 0)
			return true;
	return false;
}

static void close_card(struct search *search)
{
	search->system->close(search->system->context, search->card);
	search->card = NULL;
}

enum use { USELESS, LATER, NOW };

/* Open a card and see what it can do; a useless one is closed again. */
static enum use try_card(struct search *search, const char *path)
{
	const struct dio_kms_system *system = search->system;
	struct dio_kms_route route;
	uint32_t mode;

	search->cards++;
	snprintf(search->path, sizeof(search->path), "%s", path);
	if (system->open(system->context, path, &search->card) < 0) {
		search->cause = errno;
		search->card = NULL;
		return USELESS;
	}
	if (system->probe(system->context, search->card, search->outputs) < 0)
		search->cause = errno;
	else if (has_connector(search->outputs, search->wish->connector))
		return dio_kms_choose(search->outputs, search->wish, 0, &route, &mode) ? NOW
										       : LATER;
	close_card(search);
	return USELESS;
}

static void try_cards(struct search *search)
{
	const struct dio_kms_system *system = search->system;
	char path[64], spare[64] = "";

	for (uint32_t i = 0; system->list(system->context, i, path, sizeof(path)); i++) {
		enum use use = try_card(search, path);

		if (use == NOW)
			return;
		if (use == LATER)
			close_card(search);
		if (use == LATER && !spare[0])
			memcpy(spare, path, sizeof(spare));
	}
	if (spare[0])
		try_card(search, spare);
}

static enum dio_status fail_search(const struct search *search, struct dio_error *error)
{
	if (search->cards == 0)
		return dio_fail(error, DIO_NOT_FOUND,
				"display kms: this machine has no graphics card (/dev/dri/card*)");
	if (search->cause == EBUSY)
		return dio_fail(error, DIO_BUSY,
				"display %s: another program has the screen; end it (a desktop?) "
				"or choose window",
				search->path);
	if (dio_kms_is_refused(search->cause))
		return dio_fail(error, DIO_IO,
				"display %s: not permitted; add the user to group video",
				search->path);
	if (search->cause == EOPNOTSUPP)
		return dio_fail(error, DIO_UNSUPPORTED,
				"display %s: has no screens to scan out XRGB8888 to", search->path);
	if (search->cause)
		return dio_fail(error, dio_status_from_errno(search->cause), "display %s: %s",
				search->path, strerror(search->cause));
	return dio_fail(error, DIO_NOT_FOUND,
			"display %s: no connector is called %s; ls /sys/class/drm lists them",
			search->path, search->wish->connector);
}

enum dio_status dio_kms_open_card(const struct dio_kms_system *system, const char *card,
				  const struct dio_kms_wish *wish, void **opened, char *path,
				  size_t path_size, struct dio_kms_outputs *outputs,
				  struct dio_error *error)
{
	struct search search = {.system = system, .wish = wish, .outputs = outputs};

	if (card[0])
		try_card(&search, card);
	else
		try_cards(&search);
	if (!search.card)
		return fail_search(&search, error);
	*opened = search.card;
	snprintf(path, path_size, "%s", search.path);
	return DIO_OK;
}
