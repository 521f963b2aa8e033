/* What the files of app/bus share. */
#ifndef DIO_BUS_BUS_PRIVATE_H
#define DIO_BUS_BUS_PRIVATE_H

#include <stdbool.h>

#include "bus/bus.h"

#define DIO_BUS_CHANGES_MAX 48

/** A question to polkit that waits for its answer; a list. */
struct dio_bus_question {
	struct dio_bus_question *next;
	struct dio_bus *bus;
	sd_bus_message *message; /* the call that it is about */
	sd_bus_message_handler_t handler;
	void *context;
	sd_bus_slot *slot;
	bool answered, granted;
};

struct dio_bus {
	sd_bus *connection;
	bool is_system; /* senders are strangers: ask who they are */
	const struct dio_bus_object *object;
	const char *changed[DIO_BUS_CHANGES_MAX + 1]; /* NULL ends it */
	unsigned changed_count;
	struct dio_bus_question *questions;
};

/** Drop the questions still open. */
void dio_bus_forget_questions(struct dio_bus *bus);

/** The status behind an error name of ours, DIO_IO for others. */
enum dio_status dio_bus_status_from_name(const char *name);

#endif
