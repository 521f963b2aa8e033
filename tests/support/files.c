#include "support/files.h"

#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

unsigned char *support_read_file(const char *path, size_t *size)
{
	FILE *file = fopen(path, "rb");
	unsigned char *bytes = NULL;
	long end = -1;

	if (file && fseek(file, 0, SEEK_END) == 0)
		end = ftell(file);
	if (end >= 0 && fseek(file, 0, SEEK_SET) == 0)
		bytes = malloc((size_t)end + 1);
	if (bytes && fread(bytes, 1, (size_t)end, file) != (size_t)end) {
		free(bytes);
		bytes = NULL;
	}
	if (file)
		fclose(file);
	if (!bytes) {
		fprintf(stderr, "%s: cannot be read\n", path);
		return NULL;
	}
	bytes[end] = 0;
	*size = (size_t)end;
	return bytes;
}

float *support_read_png(const char *path, uint32_t *width, uint32_t *height)
{
	png_image image = {.version = PNG_IMAGE_VERSION};
	unsigned char *bytes = NULL;
	float *rgb = NULL;

	if (png_image_begin_read_from_file(&image, path)) {
		image.format = PNG_FORMAT_RGB;
		bytes = malloc(PNG_IMAGE_SIZE(image));
		if (bytes && png_image_finish_read(&image, NULL, bytes, 0, NULL))
			rgb = malloc(PNG_IMAGE_SIZE(image) * sizeof(float));
	}
	if (rgb) {
		for (size_t i = 0; i < PNG_IMAGE_SIZE(image); i++)
			rgb[i] = (float)bytes[i] / 255.0f;
		*width = image.width;
		*height = image.height;
	} else {
		fprintf(stderr, "%s: %s\n", path, image.message);
	}
	png_image_free(&image);
	free(bytes);
	return rgb;
}

const char *support_shared_path(const char *name, char *path, size_t size)
{
	const char *shared = getenv("DIO_SHARED_DIR");
	struct stat status;

	if (!shared) {
		fprintf(stderr, "DIO_SHARED_DIR is not set: the shared data is not looked for\n");
		return NULL;
	}
	snprintf(path, size, "%s/%s", shared, name);
	if (stat(path, &status) != 0) {
		fprintf(stderr, "%s is not there: get the shared data or set DIO_SHARED_DIR\n",
			path);
		return NULL;
	}
	return path;
}
