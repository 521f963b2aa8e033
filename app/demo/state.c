#include "demo/state.h"

#include "core/path.h"

char *dio_demo_path(const struct dio_demo *demo, const char *name)
{
	return dio_path_join(demo->options->out, name);
}
