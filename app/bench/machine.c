#include "bench/machine.h"

#include <sched.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "dvsm/engine.h"

/* "model name : AMD EPYC" of /proc/cpuinfo; boards name themselves in the device tree instead. */
static bool read_cpuinfo(char *name, size_t size)
{
	FILE *stream = fopen("/proc/cpuinfo", "re");
	char line[256];
	bool found = false;

	while (stream && !found && fgets(line, sizeof line, stream)) {
		char *colon = strchr(line, ':');

		if (!colon || strncmp(line, "model name", strlen("model name")) != 0)
			continue;
		colon += 1 + strspn(colon + 1, " \t");
		colon[strcspn(colon, "\n")] = '\0';
		snprintf(name, size, "%s", colon);
		found = *name != '\0';
	}
	if (stream)
		fclose(stream);
	return found;
}

static bool read_device_tree(char *name, size_t size)
{
	FILE *stream = fopen("/proc/device-tree/model", "re");
	size_t length = stream ? fread(name, 1, size - 1, stream) : 0;

	name[length] = '\0';
	if (stream)
		fclose(stream);
	return *name != '\0';
}

/* Of the first processor, "32768K"; 0 when the system does not say. */
static size_t read_last_cache(void)
{
	static const char PLACE[] = "/sys/devices/system/cpu/cpu0/cache/index%d/size";
	size_t last_kib = 0;
	char path[96];

	for (int level = 0; level < 8; level++) {
		unsigned long kib;
		FILE *stream;

		snprintf(path, sizeof path, PLACE, level);
		stream = fopen(path, "re");
		if (!stream)
			break;
		if (fscanf(stream, "%luK", &kib) == 1 && kib > last_kib)
			last_kib = kib;
		fclose(stream);
	}
	return last_kib * 1024;
}

/* The mask without the tier that it is named after. */
static uint32_t without_best(uint32_t mask)
{
	const char *best = dvsm_cpu_name(mask);

	for (uint32_t bit = 1; bit != 0; bit <<= 1)
		if ((mask & bit) && strcmp(dvsm_cpu_name(bit), best) == 0)
			mask &= ~bit;
	return mask;
}

/* The best last. */
static void list_tiers(uint32_t mask, char *text, size_t size)
{
	size_t used;

	*text = '\0';
	mask &= ~(uint32_t)DVSM_CPU_SCALAR;
	if (!mask)
		return;
	list_tiers(without_best(mask), text, size);
	used = strlen(text);
	snprintf(text + used, size - used, "%s%s", used ? " " : "", dvsm_cpu_name(mask));
}

void dio_machine_describe(struct dio_machine *machine)
{
	long pages = sysconf(_SC_PHYS_PAGES), page_bytes = sysconf(_SC_PAGESIZE);
	struct utsname system;
	cpu_set_t allowed;

	*machine = (struct dio_machine){.processors = 1};
	if (!read_cpuinfo(machine->processor, sizeof machine->processor) &&
	    !read_device_tree(machine->processor, sizeof machine->processor))
		snprintf(machine->processor, sizeof machine->processor, "unknown");
	if (sched_getaffinity(0, sizeof allowed, &allowed) == 0)
		machine->processors = (uint32_t)CPU_COUNT(&allowed);
	if (uname(&system) == 0)
		snprintf(machine->system, sizeof machine->system, "%.32s %.64s %.32s",
			 system.sysname, system.release, system.machine);
#if defined(__clang__)
	snprintf(machine->compiler, sizeof machine->compiler, "clang %d.%d.%d", __clang_major__,
		 __clang_minor__, __clang_patchlevel__);
#elif defined(__GNUC__)
	snprintf(machine->compiler, sizeof machine->compiler, "gcc %d.%d.%d", __GNUC__,
		 __GNUC_MINOR__, __GNUC_PATCHLEVEL__);
#endif
	list_tiers(dvsm_cpu_detect(), machine->tiers, sizeof machine->tiers);
	if (pages > 0 && page_bytes > 0)
		machine->memory_bytes = (size_t)pages * (size_t)page_bytes;
	machine->last_cache_bytes = read_last_cache();
}
