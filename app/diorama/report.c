#include "report.h"

#include <stdio.h>

#include "core/log.h"
#include "core/options.h"
#include "core/path.h"

int dio_report_failure(const char *command, const struct dio_error *error)
{
	dio_log_error("%s: %s", command, error->text);
	return DIO_EXIT_FAILED;
}

const char *dio_report_bytes(size_t bytes, char *text, size_t size)
{
	if (bytes < (size_t)1 << 20)
		snprintf(text, size, "%.1f KiB", (double)bytes / 1024);
	else
		snprintf(text, size, "%.1f MiB", (double)bytes / (1024 * 1024));
	return text;
}

cJSON *dio_report_memory(const struct dvsm_memory *memory)
{
	cJSON *object = cJSON_CreateObject();

	cJSON_AddNumberToObject(object, "weights_bytes", (double)memory->weights_bytes);
	cJSON_AddNumberToObject(object, "cache_bytes", (double)memory->cache_bytes);
	cJSON_AddNumberToObject(object, "workspace_bytes", (double)memory->workspace_bytes);
	return object;
}

void dio_report_engine(const struct dio_session *session)
{
	const struct dvsm_engine *engine = dio_session_get_engine(session);

	dio_log_note("model %s, %s, %u threads", dio_path_name(dio_session_get_model_path(session)),
		     dvsm_engine_get_cpu(engine), dvsm_engine_get_threads(engine));
}
