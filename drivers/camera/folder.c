#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

static bool is_digit(char c)
{
	return c >= '0' && c <= '9';
}

/* Compare two runs of digits by value, and move past them. */
static int compare_numbers(const char **a, const char **b)
{
	size_t n = 0, m = 0;
	int order;

	while (**a == '0' && is_digit((*a)[1]))
		(*a)++;
	while (**b == '0' && is_digit((*b)[1]))
		(*b)++;
	while (is_digit((*a)[n]))
		n++;
	while (is_digit((*b)[m]))
		m++;
	order = n != m ? (n < m ? -1 : 1) : memcmp(*a, *b, n);
	*a += n;
	*b += m;
	return order;
}

int dio_natural_compare(const char *a, const char *b)
{
	const char *p = a, *q = b;

	while (*p && *q) {
		if (is_digit(*p) && is_digit(*q)) {
			int order = compare_numbers(&p, &q);

			if (order != 0)
				return order;
		} else if (*p != *q) {
			return (unsigned char)*p < (unsigned char)*q ? -1 : 1;
		} else {
			p++;
			q++;
		}
	}
	if (*p || *q)
		return *p ? 1 : -1;
	return strcmp(a, b); /* equal but for leading zeros */
}

static int compare_names(const void *a, const void *b)
{
	char *const *p = a, *const *q = b;

	return dio_natural_compare(*p, *q);
}

static bool is_picture_name(const char *name)
{
	const char *dot = strrchr(name, '.');

	return name[0] != '.' && dot &&
	       (strcasecmp(dot, ".png") == 0 || strcasecmp(dot, ".jpg") == 0 ||
		strcasecmp(dot, ".jpeg") == 0);
}

void dio_folder_free(char **names, size_t count)
{
	for (size_t i = 0; i < count; i++)
		free(names[i]);
	free(names);
}

static bool append_name(char ***names, size_t *count, size_t *capacity, const char *name)
{
	if (*count == *capacity) {
		size_t more = *capacity ? *capacity * 2 : 64;
		char **grown = reallocarray(*names, more, sizeof(*grown));

		if (!grown)
			return false;
		*names = grown;
		*capacity = more;
	}
	(*names)[*count] = strdup(name);
	return (*names)[(*count)++] != NULL;
}

enum dio_status dio_folder_list(const char *folder, char ***names, size_t *count,
				struct dio_error *error)
{
	DIR *dir = opendir(folder);
	char **list = NULL;
	size_t n = 0, capacity = 0;
	const struct dirent *entry;

	if (!dir)
		return dio_fail(error, dio_status_from_errno(errno),
				"%s: cannot open the folder: %s", folder, strerror(errno));
	while ((entry = readdir(dir))) {
		if (is_picture_name(entry->d_name) &&
		    !append_name(&list, &n, &capacity, entry->d_name)) {
			closedir(dir);
			dio_folder_free(list, n);
			return dio_fail(error, DIO_NO_MEM, "%s: out of memory", folder);
		}
	}
	closedir(dir);
	if (n == 0)
		return dio_fail(error, DIO_NOT_FOUND, "%s: no .png, .jpg or .jpeg in this folder",
				folder);
	qsort(list, n, sizeof(*list), compare_names);
	*names = list;
	*count = n;
	return DIO_OK;
}
