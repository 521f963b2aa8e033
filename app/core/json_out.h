/* Results as JSON on standard output. */
#ifndef DIO_APP_JSON_OUT_H
#define DIO_APP_JSON_OUT_H

#include <cjson/cJSON.h>
#include <stdint.h>

#include "dio/geometry.h"
#include "dio/status.h"

/** Add a number rounded to `digits` decimals; one that is not finite becomes null. */
void dio_json_add_number(cJSON *object, const char *key, double value, int digits);
void dio_json_add_text(cJSON *object, const char *key, const char *text);
/** A number, or a list of `count`, in the fewest digits that give back its very bits: cJSON's own
 * printing lets the last bit go. What is not finite becomes null. */
cJSON *dio_json_number(double value);
cJSON *dio_json_numbers(const double *values, uint32_t count);
/** {"width","height","fx",...,"dist"} as in scene.json. */
cJSON *dio_json_camera(const struct dio_camera_model *camera);

/** Print and release `root` (NULL: memory was short). */
enum dio_status dio_json_print(cJSON *root, struct dio_error *error);
/** Write to a file beside, sync, rename; `root` stays the caller's. */
enum dio_status dio_json_write(const cJSON *root, const char *path, struct dio_error *error);

#endif
