#include "support/npz.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "support/files.h"

/* Zip: end of central directory, then one central entry a member (APPNOTE.TXT 4.3.12, 4.3.16). */
#define END_SIGNATURE   0x06054b50u
#define ENTRY_SIGNATURE 0x02014b50u
#define LOCAL_SIGNATURE 0x04034b50u
#define END_BYTES       22u
#define ENTRY_BYTES     46u
#define LOCAL_BYTES     30u
#define METHOD_STORED   0u
#define METHOD_DEFLATED 8u

struct member {
	uint32_t method, packed, size, local;
};

static uint32_t u16(const unsigned char *p)
{
	return p[0] | (uint32_t)p[1] << 8;
}

static uint32_t u32(const unsigned char *p)
{
	return u16(p) | u16(p + 2) << 16;
}

static int find_member(const unsigned char *zip, size_t size, const char *name,
		       struct member *member)
{
	size_t end = size >= END_BYTES ? size - END_BYTES : 0;

	while (end > 0 && u32(zip + end) != END_SIGNATURE)
		end--;
	if (end == 0)
		return -1;

	size_t at = u32(zip + end + 16);

	for (uint32_t left = u16(zip + end + 10); left > 0; left--) {
		if (at > size - ENTRY_BYTES || u32(zip + at) != ENTRY_SIGNATURE)
			return -1;

		size_t length = u16(zip + at + 28);

		if (length > size - at - ENTRY_BYTES)
			return -1;
		if (length == strlen(name) && memcmp(zip + at + ENTRY_BYTES, name, length) == 0) {
			*member = (struct member){u16(zip + at + 10), u32(zip + at + 20),
						  u32(zip + at + 24), u32(zip + at + 42)};
			return 0;
		}
		at += ENTRY_BYTES + length + u16(zip + at + 30) + u16(zip + at + 32);
	}
	return -1;
}

static unsigned char *unpack(const unsigned char *zip, size_t size, const struct member *member)
{
	if (member->local > size - LOCAL_BYTES || u32(zip + member->local) != LOCAL_SIGNATURE)
		return NULL;

	const unsigned char *local = zip + member->local;
	size_t at = member->local + LOCAL_BYTES + u16(local + 26) + u16(local + 28);

	if (at > size || member->packed > size - at)
		return NULL;

	unsigned char *bytes = malloc(member->size + 1);

	if (!bytes)
		return NULL;
	if (member->method == METHOD_STORED && member->packed == member->size) {
		memcpy(bytes, zip + at, member->size);
		return bytes;
	}
	if (member->method == METHOD_DEFLATED) {
		z_stream stream = {.avail_in = member->packed, .avail_out = member->size};
		/* zlib reads through a pointer to plain bytes and leaves them alone. */
		memcpy(&stream.next_in, &(const unsigned char *){zip + at}, sizeof(stream.next_in));
		stream.next_out = bytes;
		if (inflateInit2(&stream, -MAX_WBITS) == Z_OK) {
			int result = inflate(&stream, Z_FINISH);

			inflateEnd(&stream);
			if (result == Z_STREAM_END && stream.total_out == member->size)
				return bytes;
		}
	}
	free(bytes);
	return NULL;
}

static double number(const unsigned char *p, const char *type)
{
	double f8;
	float f4;
	int64_t i8;
	int32_t i4;

	if (strcmp(type, "<f8") == 0) {
		memcpy(&f8, p, sizeof(f8));
		return f8;
	}
	if (strcmp(type, "<f4") == 0) {
		memcpy(&f4, p, sizeof(f4));
		return f4;
	}
	if (strcmp(type, "<i8") == 0) {
		memcpy(&i8, p, sizeof(i8));
		return (double)i8;
	}
	if (strcmp(type, "<i4") == 0) {
		memcpy(&i4, p, sizeof(i4));
		return i4;
	}
	return *p;
}

static size_t width_of(const char *type)
{
	static const struct {
		const char *type;
		size_t width;
	} known[] = {{"<f8", 8}, {"<f4", 4}, {"<i8", 8}, {"<i4", 4}, {"|u1", 1}};

	for (size_t i = 0; i < sizeof(known) / sizeof(known[0]); i++) {
		if (strcmp(known[i].type, type) == 0)
			return known[i].width;
	}
	return 0;
}

/* The header is a Python dictionary: {'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }.
 */
static int parse_npy(const unsigned char *bytes, size_t size, struct support_array *array)
{
	char header[512], type[8];
	size_t start, length;

	if (size < 10 || memcmp(bytes, "\x93NUMPY\x01", 7) != 0)
		return -1;
	length = u16(bytes + 8);
	start = 10 + length;
	if (length >= sizeof(header) || start > size)
		return -1;
	memcpy(header, bytes + 10, length);
	header[length] = 0;

	const char *descr = strstr(header, "'descr': '");
	const char *shape = strstr(header, "'shape': (");

	if (!descr || !shape || !strstr(header, "'fortran_order': False") ||
	    sscanf(descr, "'descr': '%7[^']'", type) != 1)
		return -1;
	shape += strlen("'shape': (");
	array->count = 1;
	for (array->dims = 0; *shape >= '0' && *shape <= '9' && array->dims < 8; array->dims++) {
		char *next;

		array->shape[array->dims] = strtoul(shape, &next, 10);
		array->count *= array->shape[array->dims];
		shape = next + strspn(next, ", ");
	}

	size_t width = width_of(type);

	if (width == 0 || array->count > (size - start) / width)
		return -1;
	array->data = malloc((array->count + 1) * sizeof(double));
	if (!array->data)
		return -1;
	for (size_t i = 0; i < array->count; i++)
		array->data[i] = number(bytes + start + i * width, type);
	return 0;
}

int support_npz_read(const char *path, const char *name, struct support_array *array)
{
	char member_name[64];
	struct member member;
	struct support_array made = {0};
	unsigned char *npy = NULL;
	size_t size;
	unsigned char *zip = support_read_file(path, &size);
	int result = -1;

	if (!zip)
		return -1;
	snprintf(member_name, sizeof(member_name), "%s.npy", name);
	if (find_member(zip, size, member_name, &member) == 0)
		npy = unpack(zip, size, &member);
	if (npy && parse_npy(npy, member.size, &made) == 0)
		result = 0;
	if (result == 0)
		*array = made;
	else
		fprintf(stderr, "%s: no readable array '%s'\n", path, name);
	free(npy);
	free(zip);
	return result;
}

void support_array_free(struct support_array *array)
{
	free(array->data);
	*array = (struct support_array){0};
}
