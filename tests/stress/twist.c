#include "stress/twist.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Channels that stand out, as trained transformers have a few. */
static const size_t outliers[] = {5, 17, 40};

static bool is_outlier(size_t channel)
{
	for (size_t i = 0; i < sizeof(outliers) / sizeof(outliers[0]); i++) {
		if (outliers[i] == channel)
			return true;
	}
	return false;
}

static bool ends_with(const struct stress_tensor *tensor, const char *ending)
{
	size_t length = strlen(tensor->name), tail = strlen(ending);

	return length >= tail && strcmp(tensor->name + length - tail, ending) == 0;
}

/* A LayerNorm's weight; those of QK-norm are q_norm and k_norm. */
static bool is_layer_norm(const struct stress_tensor *tensor)
{
	return ends_with(tensor, "_norm.weight") && !ends_with(tensor, "q_norm.weight") &&
	       !ends_with(tensor, "k_norm.weight");
}

static void scale_row(const struct stress_tensor *tensor, size_t row, double factor)
{
	float *numbers = tensor->numbers + row * tensor->columns;

	for (size_t i = 0; i < tensor->columns; i++)
		numbers[i] = (float)(numbers[i] * factor);
}

static void scale(const struct stress_tensor *tensor, double factor)
{
	for (size_t row = 0; row < tensor->rows; row++)
		scale_row(tensor, row, factor);
}

void stress_twist_outlier_channels(const struct dvsm_model_config *config,
				   const struct stress_tensor *tensor, double amount)
{
	(void)config;
	/* The embedding ends in a norm, whose weight decides; then what is added in each block. */
	if (strcmp(tensor->name, "embed_norm.weight") == 0) {
		for (size_t i = 0; i < tensor->columns; i++)
			tensor->numbers[i] *= is_outlier(i) ? (float)amount : 1.0f;
	} else if (ends_with(tensor, ".out.weight") || ends_with(tensor, ".down.weight")) {
		for (size_t row = 0; row < tensor->rows; row++) {
			if (is_outlier(row))
				scale_row(tensor, row, amount);
		}
	}
}

void stress_twist_outlier_values(const struct dvsm_model_config *config,
				 const struct stress_tensor *tensor, double amount)
{
	if (!ends_with(tensor, ".qkv.weight"))
		return;
	for (size_t channel = 0; channel < config->dim; channel++) {
		if (is_outlier(channel))
			scale_row(tensor, 2 * config->dim + channel, amount);
	}
}

void stress_twist_norms(const struct dvsm_model_config *config, const struct stress_tensor *tensor,
			double amount)
{
	(void)config;
	if (is_layer_norm(tensor))
		scale(tensor, amount);
}

void stress_twist_uneven_norms(const struct dvsm_model_config *config,
			       const struct stress_tensor *tensor, double amount)
{
	(void)config;
	if (!is_layer_norm(tensor))
		return;
	for (size_t i = 0; i < tensor->columns; i++) {
		/* A fixed walk through the channels that meets both ends. */
		double part = (double)(i * 29 % tensor->columns) / (double)(tensor->columns - 1);

		tensor->numbers[i] = (float)(tensor->numbers[i] * pow(amount, 2 * part - 1));
	}
}

void stress_twist_scores(const struct dvsm_model_config *config, const struct stress_tensor *tensor,
			 double amount)
{
	/* q and k have norm sqrt(d) times their gain: scores of up to sqrt(d) gain^2. */
	if (ends_with(tensor, "q_norm.weight") || ends_with(tensor, "k_norm.weight"))
		scale(tensor, sqrt(amount / sqrt((double)config->dim / config->heads)));
}

void stress_twist_equal_keys(const struct dvsm_model_config *config,
			     const struct stress_tensor *tensor, double amount)
{
	/* Channel 0 of the norms before attention is the same for all tokens: a huge offset in the
	 * residual stream, that every key then follows. */
	if (strcmp(tensor->name, "patch_ray.weight") == 0) {
		/* d_z, the direction that all cameras of a rig look in. */
		for (size_t i = 5; i < tensor->columns; i += 6)
			tensor->numbers[i] = 100.0f;
	} else if (ends_with(tensor, ".qkv.weight")) {
		for (size_t row = config->dim; row < 2 * (size_t)config->dim; row++) {
			float *numbers = tensor->numbers + row * tensor->columns;

			scale_row(tensor, row, 1 / amount);
			numbers[0] = (float)(row % 7) - 3.5f;
		}
	}
}

void stress_twist_tiny_keys(const struct dvsm_model_config *config,
			    const struct stress_tensor *tensor, double amount)
{
	if (!ends_with(tensor, ".qkv.weight"))
		return;
	for (size_t row = config->dim; row < 2 * (size_t)config->dim; row++)
		scale_row(tensor, row, 1 / amount);
}

void stress_twist_matrices(const struct dvsm_model_config *config,
			   const struct stress_tensor *tensor, double amount)
{
	(void)config;
	if (tensor->rows > 1)
		scale(tensor, amount);
}

void stress_twist_zero(const struct dvsm_model_config *config, const struct stress_tensor *tensor,
		       double amount)
{
	(void)config;
	(void)amount;
	scale(tensor, 0);
}

/* Without "blocks.N." in front. */
static const char *short_name(const char *name)
{
	if (strncmp(name, "blocks.", 7) != 0)
		return name;

	const char *dot = strchr(name + 7, '.');

	return dot ? dot + 1 : name;
}

void stress_twist_file(unsigned char *bytes, size_t size, const struct dvsm_model_config *config,
		       stress_twist_fn *twist, double amount)
{
	uint64_t header_bytes;

	memcpy(&header_bytes, bytes, sizeof(header_bytes));

	unsigned char *numbers = bytes + sizeof(header_bytes) + header_bytes;
	cJSON *header =
		numbers <= bytes + size
			? cJSON_ParseWithLength((char *)bytes + sizeof(header_bytes), header_bytes)
			: NULL;
	const cJSON *entry;

	if (!header) {
		fprintf(stderr, "stress: the random model is not a safetensors file\n");
		exit(1);
	}
	cJSON_ArrayForEach(entry, header)
	{
		const cJSON *shape = cJSON_GetObjectItemCaseSensitive(entry, "shape");
		const cJSON *offsets = cJSON_GetObjectItemCaseSensitive(entry, "data_offsets");
		int rank = cJSON_GetArraySize(shape);

		if (rank < 1)
			continue;

		size_t begin = (size_t)cJSON_GetArrayItem(offsets, 0)->valuedouble;
		struct stress_tensor tensor = {
			.name = short_name(entry->string),
			.numbers = (float *)(void *)(numbers + begin),
			.rows = rank > 1 ? (size_t)cJSON_GetArrayItem(shape, 0)->valueint : 1,
			.columns = (size_t)cJSON_GetArrayItem(shape, rank - 1)->valueint,
		};

		twist(config, &tensor, amount);
	}
	cJSON_Delete(header);
}
