#include <errno.h>
#include <linux/capability.h>
#include <stdlib.h>

#include "bus/bus.h"
#include "bus/bus_private.h"

#define POLKIT_NAME            "org.freedesktop.PolicyKit1"
#define POLKIT_PATH            "/org/freedesktop/PolicyKit1/Authority"
#define POLKIT_INTERFACE       "org.freedesktop.PolicyKit1.Authority"
#define ALLOW_USER_INTERACTION 1u

static void drop_question(struct dio_bus *bus, struct dio_bus_question *question)
{
	struct dio_bus_question **link = &bus->questions;

	while (*link != question)
		link = &(*link)->next;
	*link = question->next;
	sd_bus_slot_unref(question->slot);
	sd_bus_message_unref(question->message);
	free(question);
}

void dio_bus_forget_questions(struct dio_bus *bus)
{
	while (bus->questions)
		drop_question(bus, bus->questions);
}

/* What polkit says; anything that is no clear yes is a no. */
static bool read_answer(sd_bus_message *reply)
{
	int authorised = 0, challenge = 0;

	if (sd_bus_message_is_method_error(reply, NULL))
		return false;
	if (sd_bus_message_enter_container(reply, 'r', "bba{ss}") < 0 ||
	    sd_bus_message_read(reply, "bb", &authorised, &challenge) < 0)
		return false;
	return authorised;
}

/* The answer is there: run the method's handler again, which now finds it. */
static int on_answer(sd_bus_message *reply, void *context, sd_bus_error *ignored)
{
	struct dio_bus_question *question = context;
	struct dio_bus *bus = question->bus;
	sd_bus_error error = SD_BUS_ERROR_NULL;
	int result;

	(void)ignored;
	question->answered = true;
	question->granted = read_answer(reply);
	result = sd_bus_message_rewind(question->message, 1);
	if (result >= 0)
		result = question->handler(question->message, question->context, &error);
	if (sd_bus_error_is_set(&error))
		sd_bus_reply_method_error(question->message, &error);
	else if (result < 0)
		sd_bus_reply_method_errno(question->message, result, NULL);
	sd_bus_error_free(&error);
	drop_question(bus, question);
	return 1;
}

static int ask_polkit(struct dio_bus *bus, struct dio_bus_question *question, const char *action)
{
	uint32_t flags = sd_bus_message_get_allow_interactive_authorization(question->message) > 0
				 ? ALLOW_USER_INTERACTION
				 : 0;

	return sd_bus_call_method_async(
		bus->connection, &question->slot, POLKIT_NAME, POLKIT_PATH, POLKIT_INTERFACE,
		"CheckAuthorization", on_answer, question, "(sa{sv})sa{ss}us", "system-bus-name", 1,
		"name", "s", sd_bus_message_get_sender(question->message), action, 0, flags, "");
}

static int refuse(sd_bus_error *error)
{
	return sd_bus_error_set(error, SD_BUS_ERROR_ACCESS_DENIED,
				"not permitted: be root, or let polkit allow it");
}

int dio_bus_authorise(struct dio_bus *bus, sd_bus_message *message, const char *action,
		      sd_bus_message_handler_t handler, void *context, sd_bus_error *error)
{
	struct dio_bus_question *question;
	int result;

	if (!bus->is_system || sd_bus_query_sender_privilege(message, CAP_SYS_ADMIN) > 0)
		return 1;
	for (question = bus->questions; question; question = question->next)
		if (question->message == message && question->answered)
			return question->granted ? 1 : refuse(error);
	question = calloc(1, sizeof *question);
	if (!question)
		return -ENOMEM;
	*question = (struct dio_bus_question){
		.next = bus->questions,
		.bus = bus,
		.message = sd_bus_message_ref(message),
		.handler = handler,
		.context = context,
	};
	bus->questions = question;
	result = ask_polkit(bus, question, action);
	if (result >= 0)
		return 0;
	drop_question(bus, question);
	return refuse(error);
}
