#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "file_fixture.h"
#include "files/sha256.h"
#include "model/model.h"

static struct dvsm_model *open_good(const char *dtype, struct fixture_file *file)
{
	size_t size;
	fixture_init_model(file, dtype);
	unsigned char *bytes = fixture_emit(file, &size);
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {""};
	if (fixture_open_model(bytes, size, &model, &error) != DVSM_OK)
		fail_msg("%s", error.text);
	free(bytes);
	return model;
}

static void assert_tensor(const float *weights, struct fixture_file *file, const char *name)
{
	const struct fixture_tensor *tensor = fixture_find(file, name);
	assert_int_equal((uintptr_t)weights % 64, 0);
	assert_memory_equal(weights, file->data + tensor->begin,
			    (size_t)(tensor->end - tensor->begin));
}

/* Rows `first` to `first` + matrix->out of a tensor, in panels, with zeros past the last row. */
static void assert_rows(const struct dvsm_matrix *matrix, size_t first, size_t out, size_t in,
			struct fixture_file *file, const char *name)
{
	const struct fixture_tensor *tensor = fixture_find(file, name);
	assert_int_equal((uintptr_t)matrix->panels % 64, 0);
	assert_int_equal(matrix->out, out);
	assert_int_equal(matrix->in, in);
	for (size_t row = 0; row < (out + 15) / 16 * 16; row++) {
		for (size_t d = 0; d < in; d++) {
			float got = matrix->panels[(row / 16 * in + d) * 16 + row % 16], want = 0;
			if (row < out)
				memcpy(&want,
				       file->data + tensor->begin + 4 * ((first + row) * in + d),
				       sizeof(want));
			assert_memory_equal(&got, &want, sizeof(want));
		}
	}
}

static const char *half_name(const char *half, const char *rest)
{
	static char name[64];
	snprintf(name, sizeof(name), "blocks.0.%s%s.weight", half, rest);
	return name;
}

static void assert_half(const struct dvsm_half_weights *w, struct fixture_file *file,
			const char *half)
{
	assert_tensor(w->norm, file, half_name(half, "_norm"));
	assert_rows(&w->query, 0, 8, 8, file, half_name(half, ".qkv"));
	assert_rows(&w->key_value, 8, 16, 8, file, half_name(half, ".qkv"));
	assert_tensor(w->q_norm, file, half_name(half, ".q_norm"));
	assert_tensor(w->k_norm, file, half_name(half, ".k_norm"));
	assert_rows(&w->out, 0, 8, 8, file, half_name(half, ".out"));
	assert_tensor(w->mlp_norm, file, half_name(half, "_mlp_norm"));
	assert_rows(&w->up, 0, 16, 8, file, half_name(half, "_mlp.up"));
	assert_rows(&w->down, 0, 8, 16, file, half_name(half, "_mlp.down"));
}

static void every_tensor_lands_where_it_belongs(void **state)
{
	(void)state;
	struct fixture_file file;
	struct dvsm_model *model = open_good("F32", &file);
	const struct dvsm_weights *w = &model->weights;
	assert_rows(&w->patch_ray, 0, 8, 24, &file, "patch_ray.weight");
	assert_rows(&w->patch_rgb, 0, 8, 12, &file, "patch_rgb.weight");
	assert_tensor(w->embed_norm, &file, "embed_norm.weight");
	assert_half(&w->blocks[0].intra, &file, "intra");
	assert_half(&w->blocks[0].cross, &file, "cross");
	assert_tensor(w->final_norm, &file, "final_norm.weight");
	assert_rows(&w->to_rgb, 0, 12, 8, &file, "to_rgb.weight");
	assert_null(w->prior_proj.panels);
	assert_int_equal(dvsm_model_get_weight_count(model), file.data_size / 4);
	assert_true(dvsm_model_get_weight_bytes(model) >= file.data_size);
	dvsm_model_close(model);
	fixture_deinit(&file);
}

static void half_and_bfloat_weights_open_too(void **state)
{
	(void)state;
	static const char *const dtypes[] = {"F32", "F16", "BF16"};
	struct dvsm_model *models[3];
	for (int i = 0; i < 3; i++) {
		struct fixture_file file;
		models[i] = open_good(dtypes[i], &file);
		fixture_deinit(&file);
	}
	/* The same numbers, rounded to 10 and 7 bits of fraction. */
	for (int k = 0; k < 16 * 24; k++) {
		float f32 = models[0]->weights.patch_ray.panels[k];
		float f16 = models[1]->weights.patch_ray.panels[k];
		float bf16 = models[2]->weights.patch_ray.panels[k];
		float size = f32 < 0 ? -f32 : f32;
		assert_true((f32 - f16) * (f32 - f16) <= size * size * 0x1p-20f + 0x1p-26f);
		assert_true((f32 - bf16) * (f32 - bf16) <= size * size * 0x1p-14f);
	}
	for (int i = 0; i < 3; i++)
		dvsm_model_close(models[i]);
}

static void the_hash_is_the_files(void **state)
{
	(void)state;
	struct fixture_file file;
	struct dvsm_model *model = open_good("F32", &file);
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	struct dvsm_sha256 hash;
	char hex[DVSM_SHA256_HEX];
	dvsm_sha256_init(&hash);
	dvsm_sha256_update(&hash, bytes, size);
	dvsm_sha256_finish(&hash, hex);
	assert_string_equal(dvsm_model_get_sha256(model), hex);
	dvsm_model_close(model);
	free(bytes);
	fixture_deinit(&file);
}

static void a_file_cut_anywhere_is_refused(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "BF16");
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	for (size_t cut = 0; cut < size; cut++) {
		struct dvsm_model *model = NULL;
		struct dvsm_error error = {""};
		assert_int_equal(fixture_open_model(bytes, cut, &model, &error), DVSM_BAD_FILE);
		assert_null(model);
		assert_text_has(&error, "m.safetensors: ");
	}
	free(bytes);
	fixture_deinit(&file);
}

static void a_cut_file_says_which_tensor_is_cut(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	file.data_size -= 1;
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor to_rgb.weight", "truncated");
	fixture_deinit(&file);
}

static void bytes_after_the_last_tensor_are_refused(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	fixture_append(&file, "tail", "F32", "[2]", 8);
	fixture_find(&file, "tail")->is_dropped = true;
	assert_model_refused(&file, DVSM_BAD_FILE, "8 bytes after the last tensor", "");
	fixture_deinit(&file);
}

/* Whatever a flipped bit does, the model is refused or it is sound; it never crashes. */
static void any_flipped_bit_of_the_header_is_survived(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	size_t size, refused = 0, flips = 0;
	unsigned char *bytes = fixture_emit(&file, &size);
	size_t header_end = size - file.data_size;
	for (size_t bit = 0; bit < 8 * header_end; bit++, flips++) {
		struct dvsm_model *model = NULL;
		struct dvsm_error error = {""};
		bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
		enum dvsm_status status = fixture_open_model(bytes, size, &model, &error);
		bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
		assert_true((status == DVSM_OK) == (model != NULL));
		if (status != DVSM_OK) {
			assert_true(status == DVSM_BAD_FILE || status == DVSM_UNSUPPORTED);
			assert_text_has(&error, "m.safetensors: ");
			refused++;
		}
		dvsm_model_close(model);
	}
	/* A few flips leave a sound file: another norm_eps, a space that becomes another. */
	assert_true(refused > flips * 98 / 100);
	free(bytes);
	fixture_deinit(&file);
}

static void a_non_finite_number_is_refused_in_every_type_and_tensor(void **state)
{
	(void)state;
	static const struct {
		const char *dtype;
		uint32_t image;
		size_t bytes;
	} cases[] = {
		{"F32", 0x7fc00000, 4}, {"F32", 0x7f800000, 4}, {"F32", 0xff800001, 4},
		{"F16", 0x7c00, 2},     {"F16", 0xfe00, 2},     {"BF16", 0x7f80, 2},
		{"BF16", 0xffc0, 2},
	};
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		struct fixture_file file;
		fixture_init_model(&file, cases[i].dtype);
		for (size_t t = 0; t < file.count; t++) {
			struct fixture_tensor *tensor = &file.tensors[t];
			unsigned char *last = file.data + tensor->end - cases[i].bytes;
			unsigned char kept[4];
			char needle[96];
			memcpy(kept, last, cases[i].bytes);
			memcpy(last, &cases[i].image, cases[i].bytes);
			snprintf(needle, sizeof(needle), "tensor %s: number ", tensor->name);
			assert_model_refused(&file, DVSM_BAD_FILE, needle, "is not finite");
			memcpy(last, kept, cases[i].bytes);
		}
		fixture_deinit(&file);
	}
}

/* Set one number of a tensor. */
static void set_number(struct fixture_file *file, const char *tensor, float value)
{
	memcpy(file->data + fixture_find(file, tensor)->begin + 4, &value, sizeof(value));
}

static void weights_that_could_overflow_float_are_refused_by_name(void **state)
{
	static const char *const named[] = {
		"patch_ray.weight",
		"patch_rgb.weight",
		"embed_norm.weight",
		"blocks.0.intra.qkv.weight",
		"blocks.0.intra.out.weight",
		"blocks.0.intra.q_norm.weight",
		"blocks.0.cross.k_norm.weight",
		"blocks.0.cross_mlp.up.weight",
		"blocks.0.cross_mlp.down.weight",
		"to_rgb.weight",
	};
	(void)state;
	for (size_t i = 0; i < sizeof(named) / sizeof(named[0]); i++) {
		struct fixture_file file;
		fixture_init_model(&file, "F32");
		set_number(&file, named[i], -1e30f);
		assert_model_refused(&file, DVSM_BAD_FILE, named[i], "range of float32");
		fixture_deinit(&file);
	}
}

static void weights_far_above_any_trained_ones_still_open(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	set_number(&file, "blocks.0.intra.out.weight", 1e6f);
	set_number(&file, "blocks.0.intra_norm.weight", -1e4f);
	set_number(&file, "blocks.0.cross.k_norm.weight", 1e6f);
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {""};
	if (fixture_open_model(bytes, size, &model, &error) != DVSM_OK)
		fail_msg("%s", error.text);
	free(bytes);
	dvsm_model_close(model);
	fixture_deinit(&file);
}

static void a_missing_tensor_is_named_whichever_it_is(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	for (size_t t = 0; t < file.count; t++) {
		struct fixture_tensor *tensor = &file.tensors[t];
		char kept[64], needle[96];
		strcpy(kept, tensor->name);
		strcpy(tensor->name, "another");
		snprintf(needle, sizeof(needle), "tensor %s: is missing", kept);
		assert_model_refused(&file, DVSM_BAD_FILE, needle, "");
		strcpy(tensor->name, kept);
	}
	fixture_deinit(&file);
}

static void refuse_changed(const char *tensor, const char *dtype, const char *shape,
			   const char *needle)
{
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	struct fixture_tensor *changed = fixture_find(&file, tensor);
	char named[96];
	if (dtype)
		strcpy(changed->dtype, dtype);
	if (shape)
		strcpy(changed->shape, shape);
	snprintf(named, sizeof(named), "tensor %s: ", tensor);
	assert_model_refused(&file, DVSM_BAD_FILE, named, needle);
	fixture_deinit(&file);
}

static void a_wrong_shape_is_refused_and_both_are_told(void **state)
{
	(void)state;
	refuse_changed("patch_ray.weight", NULL, "[24, 8]", "shape is [24, 8], must be [8, 24]");
	refuse_changed("patch_ray.weight", NULL, "[192]", "shape is [192], must be [8, 24]");
	refuse_changed("patch_ray.weight", NULL, "[1, 8, 24]", "must be [8, 24]");
	refuse_changed("embed_norm.weight", NULL, "[8, 1]", "must be [8]");
	refuse_changed("patch_ray.weight", NULL, "[8, 23]", "do not fit shape and dtype");
	refuse_changed("patch_ray.weight", NULL, "[]", "do not fit shape and dtype");
	refuse_changed("patch_ray.weight", NULL, "[-8, -24]", "no count");
	refuse_changed("patch_ray.weight", NULL, "[8.0, 24]", "no count");
	refuse_changed("patch_ray.weight", NULL, "[\"8\", 24]", "no count");
	refuse_changed("patch_ray.weight", NULL, "8", "not an array");
	refuse_changed("patch_ray.weight", NULL, "null", "not an array");
	refuse_changed("patch_ray.weight", NULL, "[1,1,1,1,1,1,1,8,24]", "more than 8 axes");
	refuse_changed("patch_ray.weight", NULL, "[4294967296, 4294967296]", "overflows");
	refuse_changed("patch_ray.weight", NULL, "[4611686018427387904, 2]", "overflows");
	refuse_changed("patch_ray.weight", NULL, "[18446744073709551616]", "no count");
}

static void a_wrong_type_is_refused(void **state)
{
	(void)state;
	refuse_changed("patch_ray.weight", "I32", NULL, "is I32, must be F32, F16 or BF16");
	refuse_changed("patch_ray.weight", "F16", NULL, "do not fit shape and dtype");
	refuse_changed("patch_ray.weight", "F64", NULL, "do not fit shape and dtype");
	refuse_changed("patch_ray.weight", "f32", NULL, "dtype is unknown");
	refuse_changed("patch_ray.weight", "", NULL, "dtype is unknown");
}

static void refuse_offsets(long long begin, long long end, const char *needle)
{
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	struct fixture_tensor *tensor = fixture_find(&file, "embed_norm.weight");
	tensor->begin = begin;
	tensor->end = end;
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor embed_norm.weight: ", needle);
	fixture_deinit(&file);
}

static void offsets_out_of_range_are_refused(void **state)
{
	(void)state;
	refuse_offsets(0x7fffffffffffffc0, 0x7fffffffffffffe0, "out of range");
	refuse_offsets(1000000, 1000032, "out of range");
	refuse_offsets(-32, 0, "two byte counts");
	refuse_offsets(32, 0, "end before they begin");
	refuse_offsets(0, 0, "do not fit shape");
}

static void overlapping_tensors_and_gaps_are_refused(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	/* The second begins inside the first. */
	file.tensors[1].begin -= 4;
	file.tensors[1].end -= 4;
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor patch_rgb.weight: ", "overlaps");
	file.tensors[1].begin += 8;
	file.tensors[1].end += 8;
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor patch_rgb.weight: ", "a gap");
	/* Two names for the same bytes. */
	file.tensors[1].begin -= 4;
	file.tensors[1].end -= 4;
	fixture_append(&file, "twin", "F32", "[8, 12]", 0);
	struct fixture_tensor *twin = fixture_find(&file, "twin");
	twin->begin = file.tensors[1].begin;
	twin->end = file.tensors[1].end;
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor twin: ", "overlaps");
	fixture_deinit(&file);
}

static void a_consistent_extra_tensor_is_fine_and_others_are_not(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	fixture_append(&file, "scales", "F32", "[3]", 12);
	fixture_append(&file, "codes", "I8", "[2, 2]", 4);
	fixture_append(&file, "empty", "U8", "[0, 5]", 0);
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	struct dvsm_model *model = NULL;
	assert_int_equal(fixture_open_model(bytes, size, &model, NULL), DVSM_OK);
	dvsm_model_close(model);
	free(bytes);

	const uint32_t nan = 0x7fc00000;
	memcpy(file.data + fixture_find(&file, "scales")->begin + 8, &nan, 4);
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor scales: number 2 is not finite", "");
	strcpy(fixture_find(&file, "codes")->shape, "[3, 2]");
	assert_model_refused(&file, DVSM_BAD_FILE, "tensor codes: ", "do not fit");
	fixture_deinit(&file);
}

static void layers_the_config_does_not_count_are_refused(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	fixture_append(&file, "blocks.1.intra_norm.weight", "F32", "[8]", 32);
	assert_model_refused(&file, DVSM_BAD_FILE, "blocks.1.intra_norm.weight", "1 layers");
	fixture_deinit(&file);
}

static void a_file_that_is_no_model_is_refused(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	strcpy(file.format, "pt");
	assert_model_refused(&file, DVSM_BAD_FILE, "format is pt", "must be dvsm");
	strcpy(file.format, "dvsm");
	strcpy(file.version, "2");
	assert_model_refused(&file, DVSM_UNSUPPORTED, "version 2", "only 1");
	fixture_deinit(&file);
}

static void a_header_that_is_none_is_refused(void **state)
{
	(void)state;
	static const struct {
		const char *header, *needle;
	} cases[] = {
		{"", "does not begin with {"},
		{"[]", "does not begin with {"},
		{" {}", "does not begin with {"},
		{"{", "not JSON"},
		{"{}x", "not JSON"},
		{"{}", "is no model"},
		{"{\"__metadata__\":[]}", "__metadata__ is not an object"},
		{"{\"__metadata__\":{\"format\":1}}", "format is not a string"},
		{"{\"a\":1}", "tensor a: is not described"},
		{"{\"a\":{}}", "tensor a: must have dtype"},
		{"{\"a\":{\"dtype\":\"U8\",\"shape\":[0],\"x\":[0,0]}}", "no data_offsets"},
		{"{\"a\":{\"x\":\"U8\",\"shape\":[0],\"data_offsets\":[0,0]}}", "no dtype"},
		{"{\"a\":{\"dtype\":\"U8\",\"x\":[0],\"data_offsets\":[0,0]}}", "no shape"},
		{"{\"a\":{\"dtype\":\"U8\",\"shape\":[0],\"data_offsets\":[0]}}", "array of two"},
		{"{\"a\":{\"dtype\":\"U8\",\"shape\":[0],\"data_offsets\":[0,0],\"b\":1}}",
		 "nothing else"},
		{"{\"a\":{\"dtype\":3,\"shape\":[0],\"data_offsets\":[0,0]}}", "dtype is unknown"},
	};
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		size_t size;
		unsigned char *bytes = fixture_emit_header(cases[i].header, NULL, 0, &size);
		struct dvsm_model *model = NULL;
		struct dvsm_error error = {""};
		assert_int_equal(fixture_open_model(bytes, size, &model, &error), DVSM_BAD_FILE);
		assert_text_has(&error, cases[i].needle);
		free(bytes);
	}
}

static void a_huge_header_length_is_refused(void **state)
{
	(void)state;
	struct fixture_file file;
	fixture_init_model(&file, "F32");
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	const uint64_t lengths[] = {UINT64_MAX, UINT64_MAX - 8,     (uint64_t)1 << 63,       size,
				    size - 7,   (uint64_t)64 << 20, ((uint64_t)64 << 20) + 1};
	for (size_t i = 0; i < sizeof(lengths) / sizeof(lengths[0]); i++) {
		struct dvsm_model *model = NULL;
		struct dvsm_error error = {""};
		memcpy(bytes, &lengths[i], 8);
		assert_int_equal(fixture_open_model(bytes, size, &model, &error), DVSM_BAD_FILE);
		assert_text_has(&error, "header");
	}
	free(bytes);
	fixture_deinit(&file);
}

static void a_path_that_cannot_be_read_is_an_io_error(void **state)
{
	(void)state;
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {""};
	assert_int_equal(dvsm_model_open("/nonexistent/m.safetensors", &model, &error), DVSM_IO);
	assert_text_has(&error, "/nonexistent/m.safetensors: cannot be opened: ");
	assert_int_equal(dvsm_model_open("/", &model, &error), DVSM_IO);
	assert_text_has(&error, "not a regular file");
	assert_int_equal(dvsm_model_open("/dev/zero", &model, &error), DVSM_IO);
	assert_int_equal(dvsm_model_open(NULL, &model, &error), DVSM_BAD_ARG);
	assert_null(model);
}

static void a_long_name_leaves_room_for_the_fault(void **state)
{
	(void)state;
	char path[3000];
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {""};
	memset(path, 'd', sizeof(path));
	strcpy(path + sizeof(path) - 20, "/m.safetensors");
	assert_int_equal(dvsm_model_open(path, &model, &error), DVSM_IO);
	assert_text_has(&error, "/m.safetensors: cannot be opened: ");
}

/* The last matrix in int8: its own tensor gets another name, which is none the model asks for. */
static void make_to_rgb_int8(struct fixture_file *file, bool scale_first)
{
	fixture_init_model(file, "F32");
	snprintf(fixture_find(file, "to_rgb.weight")->name, sizeof(file->tensors[0].name),
		 "unused.weight");
	if (scale_first)
		fixture_append(file, "to_rgb.weight_scale", "F32", "[12]", 48);
	fixture_append(file, "to_rgb.weight", "I8", "[12, 8]", 96);
}

static void int8_rows_are_weights_times_their_scale(void **state)
{
	(void)state;
	struct fixture_file file;
	make_to_rgb_int8(&file, true);
	float *scale =
		(float *)(void *)(file.data + fixture_find(&file, "to_rgb.weight_scale")->begin);
	signed char *numbers =
		(signed char *)(file.data + fixture_find(&file, "to_rgb.weight")->begin);
	for (int row = 0; row < 12; row++) {
		scale[row] = 0.25f * (float)(row + 1);
		for (int d = 0; d < 8; d++)
			numbers[row * 8 + d] = (signed char)(17 * d - 127 + row);
	}
	size_t size;
	unsigned char *bytes = fixture_emit(&file, &size);
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {""};
	assert_int_equal(fixture_open_model(bytes, size, &model, &error), DVSM_OK);
	for (size_t row = 0; row < 12; row++) {
		for (size_t d = 0; d < 8; d++)
			assert_true(model->weights.to_rgb.panels[d * 16 + row] ==
				    scale[row] * numbers[row * 8 + d]);
	}
	dvsm_model_close(model);
	free(bytes);
	fixture_deinit(&file);
}

static void int8_without_a_scale_before_it_is_refused(void **state)
{
	(void)state;
	struct fixture_file file;
	make_to_rgb_int8(&file, false);
	assert_model_refused(&file, DVSM_BAD_FILE, "to_rgb.weight_scale", "missing");
	fixture_append(&file, "to_rgb.weight_scale", "F32", "[12]", 48);
	assert_model_refused(&file, DVSM_BAD_FILE, "to_rgb.weight_scale", "before");
	fixture_deinit(&file);
	make_to_rgb_int8(&file, true);
	snprintf(fixture_find(&file, "to_rgb.weight_scale")->shape, sizeof(file.tensors[0].shape),
		 "[3, 4]");
	assert_model_refused(&file, DVSM_BAD_FILE, "to_rgb.weight_scale", "[12]");
	fixture_deinit(&file);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_tensor_lands_where_it_belongs),
		cmocka_unit_test(half_and_bfloat_weights_open_too),
		cmocka_unit_test(the_hash_is_the_files),
		cmocka_unit_test(a_file_cut_anywhere_is_refused),
		cmocka_unit_test(a_cut_file_says_which_tensor_is_cut),
		cmocka_unit_test(bytes_after_the_last_tensor_are_refused),
		cmocka_unit_test(any_flipped_bit_of_the_header_is_survived),
		cmocka_unit_test(a_non_finite_number_is_refused_in_every_type_and_tensor),
		cmocka_unit_test(weights_that_could_overflow_float_are_refused_by_name),
		cmocka_unit_test(weights_far_above_any_trained_ones_still_open),
		cmocka_unit_test(a_missing_tensor_is_named_whichever_it_is),
		cmocka_unit_test(a_wrong_shape_is_refused_and_both_are_told),
		cmocka_unit_test(a_wrong_type_is_refused),
		cmocka_unit_test(offsets_out_of_range_are_refused),
		cmocka_unit_test(overlapping_tensors_and_gaps_are_refused),
		cmocka_unit_test(a_consistent_extra_tensor_is_fine_and_others_are_not),
		cmocka_unit_test(layers_the_config_does_not_count_are_refused),
		cmocka_unit_test(a_file_that_is_no_model_is_refused),
		cmocka_unit_test(a_header_that_is_none_is_refused),
		cmocka_unit_test(a_huge_header_length_is_refused),
		cmocka_unit_test(a_path_that_cannot_be_read_is_an_io_error),
		cmocka_unit_test(a_long_name_leaves_room_for_the_fault),
		cmocka_unit_test(int8_rows_are_weights_times_their_scale),
		cmocka_unit_test(int8_without_a_scale_before_it_is_refused),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
