/* Properties as they come over the bus, as JSON values. */
#ifndef DIO_DIORAMA_CTL_VALUES_H
#define DIO_DIORAMA_CTL_VALUES_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <systemd/sd-bus.h>

/**
 * Read an a{sv} into the members of `object`; a member that is there is replaced.
 *
 * false: the message is not what it should be, or memory is short
 */
bool ctl_read_properties(sd_bus_message *message, cJSON *object);

/** All arguments of a message as a list; release with cJSON_Delete(). NULL: as above. */
cJSON *ctl_read_arguments(sd_bus_message *message);

/** A value as one line for people; release with cJSON_free(). */
char *ctl_value_text(const cJSON *value);

#endif
