#include "process.h"

#include <dirent.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "dio/clock.h"

/* The number behind `key` in a file of /proc. */
static bool read_number(pid_t pid, const char *file, const char *key, uint64_t *number)
{
	unsigned long long value;
	char path[64], line[512];
	bool found = false;
	FILE *in;

	snprintf(path, sizeof path, "/proc/%d/%s", (int)pid, file);
	in = fopen(path, "re");
	if (!in)
		return false;
	while (!found && fgets(line, sizeof line, in))
		found = strncmp(line, key, strlen(key)) == 0 &&
			sscanf(line + strlen(key), "%llu", &value) == 1;
	fclose(in);
	if (found)
		*number = value;
	return found;
}

static bool read_worked(pid_t pid, double *worked_s)
{
	unsigned long long user, system;
	char path[64], text[1024], *end;
	bool ok = false;
	FILE *in;

	snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
	in = fopen(path, "re");
	if (!in)
		return false;
	/* The name, in parentheses, may hold anything; times are fields 14 and 15. */
	if (fgets(text, sizeof text, in) && (end = strrchr(text, ')')))
		ok = sscanf(end + 1, " %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %llu %llu",
			    &user, &system) == 2;
	fclose(in);
	if (ok)
		*worked_s = (double)(user + system) / (double)sysconf(_SC_CLK_TCK);
	return ok;
}

static uint32_t count_descriptors(pid_t pid)
{
	const struct dirent *entry;
	uint32_t count = 0;
	char path[64];
	DIR *folder;

	snprintf(path, sizeof path, "/proc/%d/fd", (int)pid);
	folder = opendir(path);
	while (folder && (entry = readdir(folder)))
		count += entry->d_name[0] != '.';
	if (folder)
		closedir(folder);
	return count;
}

bool process_sample(pid_t pid, struct process_sample *sample)
{
	uint64_t threads, anonymous, shared;

	sample->at_s = (double)dio_clock_ns() * 1e-9;
	sample->descriptors = count_descriptors(pid);
	if (!read_worked(pid, &sample->worked_s) || sample->descriptors == 0 ||
	    !read_number(pid, "status", "Threads:", &threads) ||
	    !read_number(pid, "smaps_rollup", "Pss:", &sample->pss_kib) ||
	    !read_number(pid, "smaps_rollup", "Pss_Anon:", &anonymous) ||
	    !read_number(pid, "smaps_rollup", "Pss_Shmem:", &shared))
		return false;
	sample->own_kib = anonymous + shared;
	sample->threads = (uint32_t)threads;
	return true;
}

double process_share(const struct process_sample *from, const struct process_sample *to)
{
	return (to->worked_s - from->worked_s) / (to->at_s - from->at_s);
}
