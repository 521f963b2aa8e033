/* import: scenes of other programs to scene.json. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "core/import.h"
#include "core/options.h"
#include "core/path.h"
#include "report.h"

struct import_job {
	const char *input, *out, *images, *name;
	uint32_t hold_out;
};

/* Every n-th frame, from the first, becomes a target: it is kept back to compare with. */
static void mark_targets(struct dio_scene_file *scene, uint32_t every)
{
	for (uint32_t i = 0; every && i < scene->frame_count; i += every)
		scene->frames[i].role = DIO_ROLE_TARGET;
}

/* The scene is called after the folder of its source unless a name is given. */
static enum dio_status name_scene(const struct import_job *job, struct dio_scene_file *scene,
				  struct dio_error *error)
{
	char *folder = realpath(job->input, NULL), *name = NULL;

	if (folder && !dio_path_is_folder(folder))
		*strrchr(folder, '/') = '\0';
	if (job->name)
		name = strdup(job->name);
	else if (folder && *dio_path_name(folder))
		name = strdup(dio_path_name(folder));
	free(folder);
	if (!name)
		return job->name ? dio_fail(error, DIO_NO_MEM, "no memory") : DIO_OK;
	free(scene->name);
	scene->name = name;
	return DIO_OK;
}

static enum dio_status read_input(const struct import_job *job, const char *out_folder,
				  struct dio_scene_file *scene, struct dio_error *error)
{
	char *inside;
	enum dio_status status;

	if (!dio_path_is_folder(job->input))
		return dio_import_transforms(job->input, out_folder, scene, error);
	inside = dio_path_join(job->input, "cameras.txt");
	if (inside && dio_path_is_file(inside)) {
		free(inside);
		return dio_import_colmap(job->input, job->images, out_folder, scene, error);
	}
	free(inside);
	inside = dio_path_join(job->input, "transforms.json");
	if (inside && dio_path_is_file(inside))
		status = dio_import_transforms(inside, out_folder, scene, error);
	else
		status =
			dio_fail(error, DIO_NOT_FOUND,
				 "%s: holds neither transforms.json nor cameras.txt and images.txt "
				 "(a binary COLMAP model: run colmap model_converter first)",
				 job->input);
	free(inside);
	return status;
}

static enum dio_status import_scene(const struct import_job *job, struct dio_error *error)
{
	char *out_folder = dio_path_folder(job->out);
	struct dio_scene_file scene = {0};
	enum dio_status status;

	if (!out_folder)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", job->out);
	if (!dio_path_is_folder(out_folder))
		status = dio_fail(error, DIO_NOT_FOUND, "%s: no such folder", out_folder);
	else
		status = read_input(job, out_folder, &scene, error);
	free(out_folder);
	if (status == DIO_OK)
		status = name_scene(job, &scene, error);
	if (status == DIO_OK) {
		mark_targets(&scene, job->hold_out);
		status = dio_scene_file_write(&scene, job->out, error);
	}
	if (status == DIO_OK)
		printf("%s: %u context views, %u targets\n", job->out,
		       dio_scene_file_count(&scene, DIO_ROLE_CONTEXT),
		       dio_scene_file_count(&scene, DIO_ROLE_TARGET));
	dio_scene_file_deinit(&scene);
	return status;
}

int dio_command_import(int argc, char **argv)
{
	struct import_job job = {0};
	const struct dio_option options[] = {
		{"out", DIO_OPTION_TEXT, "FILE", "the scene.json to write", &job.out, 0, 0, true},
		{"images", DIO_OPTION_TEXT, "DIR",
		 "COLMAP: folder of the pictures (default: images beside\n"
		 "the model, or one or two folders above)",
		 &job.images, 0, 0, false},
		{"hold-out", DIO_OPTION_COUNT, "N",
		 "every N-th frame, from the first, becomes a target (default:\n"
		 "0, all are context)",
		 &job.hold_out, 0, 1e6, false},
		{"name", DIO_OPTION_TEXT, "NAME", "the scene's name (default: its folder's)",
		 &job.name, 0, 0, false},
	};
	const struct dio_usage usage = {
		.command = "import",
		.summary = "turn transforms.json or a COLMAP text model into scene.json",
		.arguments = "INPUT",
		.details =
			"INPUT is a transforms.json (nerfstudio, instant-ngp, Blender), a folder "
			"with "
			"one, or a\nfolder with COLMAP's cameras.txt and images.txt. Pictures stay "
			"where they are.\nThere, pixel (0,0) has its centre at (0.5, 0.5); in "
			"scene.json it is at (0, 0): 0.5 is\ntaken off cx and cy. OpenGL axes are "
			"turned to OpenCV's.",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	char **arguments;
	uint32_t count;
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	job.input = arguments[0];
	if (import_scene(&job, &error) != DIO_OK)
		return dio_report_failure(usage.command, &error);
	return DIO_EXIT_OK;
}
