#include "core/tum.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/text.h"
#include "dio/atomic_file.h"

#define POSES_MAX      1000000u
#define FILE_BYTES_MAX (256u << 20)
#define FIELDS         8

enum dio_status dio_trajectory_init(struct dio_trajectory *trajectory, uint32_t count)
{
	if (count > POSES_MAX)
		return DIO_BAD_ARG;
	trajectory->time_s = calloc(count ? count : 1, sizeof *trajectory->time_s);
	trajectory->poses = calloc(count ? count : 1, sizeof *trajectory->poses);
	trajectory->count = count;
	if (trajectory->time_s && trajectory->poses)
		return DIO_OK;
	dio_trajectory_deinit(trajectory);
	return DIO_NO_MEM;
}

void dio_trajectory_deinit(struct dio_trajectory *trajectory)
{
	free(trajectory->time_s);
	free(trajectory->poses);
	*trajectory = (struct dio_trajectory){0};
}

/* The largest of w, x, y, z is found from the diagonal, the others from it: no division by little.
 */
void dio_quaternion_from_pose(const struct dio_pose *pose, double quaternion[4])
{
	const double *m = pose->world_from_camera;
	double r[3][3], q[4], trace;
	int big = 0;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			r[i][j] = m[4 * i + j];
	trace = r[0][0] + r[1][1] + r[2][2];
	for (int i = 1; i < 3; i++)
		if (r[i][i] > r[big][big])
			big = i;
	if (trace > r[big][big]) {
		q[3] = 1 + trace;
		q[0] = r[2][1] - r[1][2];
		q[1] = r[0][2] - r[2][0];
		q[2] = r[1][0] - r[0][1];
	} else {
		int j = (big + 1) % 3, k = (big + 2) % 3;

		q[big] = 1 + r[big][big] - r[j][j] - r[k][k];
		q[j] = r[big][j] + r[j][big];
		q[k] = r[big][k] + r[k][big];
		q[3] = r[k][j] - r[j][k];
	}
	double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);

	norm = q[3] < 0 ? -norm : norm;
	for (int i = 0; i < 4; i++)
		quaternion[i] = q[i] / norm;
}

void dio_pose_from_quaternion(const double quaternion[4], const double position[3],
			      struct dio_pose *pose)
{
	double x = quaternion[0], y = quaternion[1], z = quaternion[2], w = quaternion[3];
	const double m[16] = {
		1 - 2 * (y * y + z * z),
		2 * (x * y - z * w),
		2 * (x * z + y * w),
		position[0],
		2 * (x * y + z * w),
		1 - 2 * (x * x + z * z),
		2 * (y * z - x * w),
		position[1],
		2 * (x * z - y * w),
		2 * (y * z + x * w),
		1 - 2 * (x * x + y * y),
		position[2],
		0,
		0,
		0,
		1,
	};

	memcpy(pose->world_from_camera, m, sizeof m);
}

/* What is wrong with a line, or NULL. */
static const char *parse_line(char *line, double fields[FIELDS])
{
	char *at = line, *end;
	double norm = 0;

	for (int i = 0; i < FIELDS; i++, at = end) {
		fields[i] = strtod(at, &end);
		if (end == at)
			return "eight numbers are wanted: timestamp tx ty tz qx qy qz qw";
		if (!isfinite(fields[i]))
			return "a number is not finite";
	}
	while (*at == ' ' || *at == '\t' || *at == '\r')
		at++;
	if (*at)
		return "more than eight fields";
	for (int i = 4; i < FIELDS; i++)
		norm += fields[i] * fields[i];
	norm = sqrt(norm);
	/* Files state three to six digits; more than a hundredth off is no rotation. */
	if (fabs(norm - 1) > 1e-2)
		return "the quaternion qx qy qz qw is not of length 1";
	for (int i = 4; i < FIELDS; i++)
		fields[i] /= norm;
	return NULL;
}

static uint32_t count_lines(const char *text)
{
	uint32_t lines = 1;

	for (; *text; text++)
		lines += *text == '\n';
	return lines;
}

static enum dio_status parse_text(char *text, const char *path, struct dio_trajectory *trajectory,
				  struct dio_error *error)
{
	uint32_t count = 0, number = 0;
	char *rest = text, *line;

	while ((line = strsep(&rest, "\n"))) {
		double fields[FIELDS];
		const char *fault;

		number++;
		line += strspn(line, " \t\r");
		if (*line == '\0' || *line == '#')
			continue;
		fault = parse_line(line, fields);
		if (fault)
			return dio_fail(error, DIO_BAD_FILE, "%s: line %u: %s", path, number,
					fault);
		trajectory->time_s[count] = fields[0];
		dio_pose_from_quaternion(fields + 4, fields + 1, &trajectory->poses[count]);
		count++;
	}
	trajectory->count = count;
	if (count == 0)
		return dio_fail(error, DIO_BAD_FILE, "%s: no pose in it", path);
	return DIO_OK;
}

enum dio_status dio_tum_read(const char *path, struct dio_trajectory *trajectory,
			     struct dio_error *error)
{
	struct dio_trajectory made = {0};
	enum dio_status status;
	char *text = NULL;
	size_t size;

	status = dio_text_read(path, FILE_BYTES_MAX, &text, &size, error);
	if (status != DIO_OK)
		return status;
	status = dio_trajectory_init(&made, count_lines(text));
	if (status != DIO_OK)
		dio_fail(error, status, "%s: more than %u poses, or no memory", path, POSES_MAX);
	else
		status = parse_text(text, path, &made, error);
	free(text);
	if (status == DIO_OK)
		*trajectory = made;
	else
		dio_trajectory_deinit(&made);
	return status;
}

enum dio_status dio_tum_write(const char *path, const struct dio_trajectory *trajectory,
			      struct dio_error *error)
{
	struct dio_atomic_file *file;
	enum dio_status status = dio_atomic_file_open(path, &file, error);
	FILE *stream;

	if (status != DIO_OK)
		return status;
	/* A failed write stays on the stream and is told by the commit. */
	stream = dio_atomic_file_stream(file);
	fputs("# timestamp tx ty tz qx qy qz qw\n", stream);
	for (uint32_t i = 0; i < trajectory->count; i++) {
		const double *m = trajectory->poses[i].world_from_camera;
		double q[4];

		dio_quaternion_from_pose(&trajectory->poses[i], q);
		fprintf(stream, "%.9f %.9g %.9g %.9g %.9f %.9f %.9f %.9f\n", trajectory->time_s[i],
			m[3], m[7], m[11], q[0], q[1], q[2], q[3]);
	}
	return dio_atomic_file_commit(file, error);
}
