#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "core/orbit.h"
#include "core/progress.h"
#include "core/sheet.h"
#include "demo/state.h"
#include "dio/video.h"

#define ORBIT_FRAMES_PER_SECOND 25.0
#define CELL_PX                 192u
#define ROW_CELLS_MAX           8u

static enum dio_status copy_picture(const struct dio_picture *from, struct dio_picture *to)
{
	enum dio_status status = dio_picture_init(to, from->width, from->height);

	if (status == DIO_OK)
		for (size_t i = 0; i < (size_t)from->width * from->height * 3; i++)
			to->rgb[i] = from->rgb[i];
	return status;
}

/* One picture of the path into the video; every so manyth is kept. */
static enum dio_status put_picture(struct dio_demo *demo, uint32_t index, uint32_t step,
				   const struct dio_picture *picture, struct dio_video *video,
				   struct dio_error *error)
{
	enum dio_status status = dio_video_append(video, picture, error);

	if (status != DIO_OK || index % step != 0)
		return status;
	status = copy_picture(picture, &demo->orbit[demo->orbit_count]);
	if (status != DIO_OK)
		return dio_fail(error, status, "no memory for the contact sheet");
	demo->orbit_count++;
	return DIO_OK;
}

/* As many pictures of the path as are best rendered at once, from `first` on; *count says how many.
 */
static enum dio_status render_some(struct dio_demo *demo, const struct dio_trajectory *path,
				   uint32_t first, struct dio_picture *pictures, uint32_t *count,
				   uint64_t *sum_ns, struct dio_error *error)
{
	const struct dio_camera_model *camera = &demo->set.context[0].camera;
	const struct dio_camera_model *cameras[DIO_BATCH_MAX];
	const struct dio_pose *poses[DIO_BATCH_MAX];
	uint32_t some = dio_session_batch_size(demo->session, camera);
	struct dvsm_stats stats = {0};
	enum dio_status status;

	some = path->count - first < some ? path->count - first : some;
	for (uint32_t i = 0; i < some; i++) {
		cameras[i] = camera;
		poses[i] = &path->poses[first + i];
	}
	status = dio_session_render_batch(demo->session, cameras, poses, some, pictures, &stats,
					  error);
	*sum_ns += stats.time_ns;
	*count = some;
	return status;
}

static enum dio_status render_path(struct dio_demo *demo, const struct dio_trajectory *path,
				   struct dio_video *video, struct dio_error *error)
{
	uint32_t step = (path->count + ROW_CELLS_MAX - 1) / ROW_CELLS_MAX;
	struct dio_picture pictures[DIO_BATCH_MAX] = {0};
	struct dio_progress progress;
	enum dio_status status = DIO_OK;
	uint64_t sum_ns = 0;

	dio_progress_init(&progress, "rendering the orbit");
	for (uint32_t at = 0, count; at < path->count && status == DIO_OK; at += count) {
		status = render_some(demo, path, at, pictures, &count, &sum_ns, error);
		for (uint32_t i = 0; i < count && status == DIO_OK; i++)
			status = put_picture(demo, at + i, step, &pictures[i], video, error);
		dio_progress_update(&progress, (double)(at + count) / path->count);
	}
	dio_progress_done(&progress);
	for (uint32_t i = 0; i < DIO_BATCH_MAX; i++)
		dio_picture_deinit(&pictures[i]);
	demo->orbit_render_ns = path->count > 0 ? sum_ns / path->count : 0;
	return status;
}

static enum dio_status plan_path(const struct dio_demo *demo, struct dio_trajectory *path,
				 struct dio_error *error)
{
	uint32_t count = demo->set.context_count;
	struct dio_pose *poses = malloc(count * sizeof *poses);
	enum dio_status status;

	if (!poses)
		return dio_fail(error, DIO_NO_MEM, "no memory for the orbit");
	for (uint32_t i = 0; i < count; i++)
		poses[i] = demo->set.context[i].pose;
	status = dio_orbit_path(poses, count, demo->options->orbit_frames, ORBIT_FRAMES_PER_SECOND,
				path);
	free(poses);
	return status == DIO_OK ? DIO_OK : dio_fail(error, status, "no memory for the orbit");
}

enum dio_status dio_demo_render_orbit(struct dio_demo *demo, struct dio_error *error)
{
	const struct dio_camera_model *camera = &demo->set.context[0].camera;
	struct dio_trajectory path = {0};
	struct dio_video *video = NULL;
	char *file = dio_demo_path(demo, "orbit.mp4");
	enum dio_status status = plan_path(demo, &path, error);

	demo->orbit = calloc(ROW_CELLS_MAX, sizeof *demo->orbit);
	if (status == DIO_OK && (!file || !demo->orbit))
		status = dio_fail(error, DIO_NO_MEM, "no memory for the orbit");
	if (status == DIO_OK)
		status = dio_video_open(file, camera->width, camera->height,
					ORBIT_FRAMES_PER_SECOND, &video, error);
	if (status == DIO_OK)
		status = render_path(demo, &path, video, error);
	if (status == DIO_OK) {
		status = dio_video_close(video, error);
		video = NULL;
	}
	dio_video_close(video, NULL);
	dio_trajectory_deinit(&path);
	free(file);
	return status;
}

/* One row of the sheet in the making. */
struct row {
	const struct dio_picture *pictures[ROW_CELLS_MAX];
	char text[ROW_CELLS_MAX][32];
	const char *captions[ROW_CELLS_MAX];
	uint32_t count;
};

static void add(struct row *row, const struct dio_picture *picture)
{
	if (row->count == ROW_CELLS_MAX)
		return;
	row->captions[row->count] = row->text[row->count];
	row->pictures[row->count++] = picture;
}

enum dio_status dio_demo_write_sheet(const struct dio_demo *demo, struct dio_error *error)
{
	const struct dio_evaluation *eval = &demo->evaluation;
	struct row inputs = {0}, rendered = {0}, actual = {0}, orbit = {0};
	struct dio_picture sheet = {0};
	char *file = dio_demo_path(demo, "sheet.png");
	enum dio_status status;

	for (uint32_t i = 0; i < demo->set.context_count && i < ROW_CELLS_MAX; i++) {
		snprintf(inputs.text[i], sizeof inputs.text[i], "%s", demo->set.context[i].name);
		add(&inputs, &demo->set.context[i].picture);
	}
	for (uint32_t i = 0; i < eval->count && i < ROW_CELLS_MAX; i++) {
		const struct dio_score *score = &eval->scores[i];

		snprintf(rendered.text[i], sizeof rendered.text[i], "%.2f dB", score->psnr_db);
		add(&rendered, &score->rendered);
		snprintf(actual.text[i], sizeof actual.text[i], "%s",
			 demo->set.target[score->target].name);
		add(&actual, &demo->set.target[score->target].picture);
	}
	for (uint32_t i = 0; i < demo->orbit_count; i++)
		add(&orbit, &demo->orbit[i]);

	struct dio_sheet_row rows[] = {
		{"INPUTS", inputs.pictures, inputs.captions, inputs.count},
		{"RENDERED, HELD-BACK VIEWPOINTS", rendered.pictures, rendered.captions,
		 rendered.count},
		{"TRUE", actual.pictures, actual.captions, actual.count},
		{"ORBIT", orbit.pictures, NULL, orbit.count},
	};

	status = file ? dio_sheet_draw(rows, sizeof rows / sizeof *rows, CELL_PX, &sheet, error)
		      : dio_fail(error, DIO_NO_MEM, "no memory for the contact sheet");
	if (status == DIO_OK)
		status = dio_picture_write(file, &sheet, error);
	dio_picture_deinit(&sheet);
	free(file);
	return status;
}
