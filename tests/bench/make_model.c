/* Writes a model file with random weights of a given size, to measure time and memory with. */
#include <stdio.h>
#include <stdlib.h>

#include "support/random_model.h"

static const char usage[] = "Usage: make_model FILE DIM HEADS LAYERS PATCH\n"
			    "A model file with random weights; DIM 768, 12 heads, 12 layers and "
			    "patch 16 are the paper's.\n";

/* A number of 1..65536, or 0. */
static uint32_t number(const char *text)
{
	char *end;
	unsigned long value = strtoul(text, &end, 10);

	return *end || value > 65536 ? 0 : (uint32_t)value;
}

static bool write_file(const char *path, const unsigned char *bytes, size_t size)
{
	FILE *file = fopen(path, "wb");

	if (!file)
		return false;

	bool written = fwrite(bytes, 1, size, file) == size;

	return fclose(file) == 0 && written;
}

int main(int argc, char **argv)
{
	struct support_random random = {1};
	struct dvsm_model_config config = {.mlp_ratio = 4, .norm_eps = 1e-6};
	size_t size;

	if (argc == 6) {
		config.dim = number(argv[2]);
		config.heads = number(argv[3]);
		config.layers = number(argv[4]);
		config.patch_px = number(argv[5]);
	}
	if (config.dim < 1 || config.heads < 1 || config.dim % config.heads != 0 ||
	    config.layers < 1 || config.patch_px < 1) {
		fputs(usage, stderr);
		return 2;
	}

	unsigned char *bytes = support_random_model_file(&config, &random, &size);

	if (!bytes) {
		fputs("make_model: no memory for a model of this size\n", stderr);
		return 1;
	}

	bool written = write_file(argv[1], bytes, size);

	free(bytes);
	if (!written) {
		perror(argv[1]);
		return 1;
	}
	return 0;
}
