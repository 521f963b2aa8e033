#include "viewd/viewpoint.h"

#include <math.h>

#define ORBIT_POSES 480
#define ORBIT_RATE  30.0 /* poses a second: once round in 16 s */

const char *dio_viewpoint_source_name(enum dio_viewpoint_source source)
{
	static const char *const NAMES[] = {"tracked", "orbit", "path", "hand"};

	return NAMES[source];
}

enum dio_status dio_viewpoint_set_scene(struct dio_viewpoint *viewpoint,
					const struct dio_pose *poses, uint32_t count,
					struct dio_error *error)
{
	struct dio_trajectory orbit = {0};
	struct dio_orbit fitted;
	enum dio_status status = dio_orbit_path(poses, count, ORBIT_POSES, ORBIT_RATE, &orbit);

	if (status != DIO_OK)
		return dio_fail(error, status, "no memory for a path round the scene");
	dio_viewpoint_deinit(viewpoint);
	viewpoint->orbit = orbit;
	dio_orbit_fit(poses, count, &fitted);
	dio_eye_reset(&fitted, &viewpoint->eye);
	return DIO_OK;
}

void dio_viewpoint_set_path(struct dio_viewpoint *viewpoint, struct dio_trajectory *path)
{
	dio_trajectory_deinit(&viewpoint->path);
	viewpoint->path = *path;
	*path = (struct dio_trajectory){0};
}

void dio_viewpoint_play(struct dio_viewpoint *viewpoint, bool play, uint64_t now_ns)
{
	viewpoint->playing = play;
	viewpoint->by_hand = false;
	viewpoint->began_ns = now_ns;
}

void dio_viewpoint_track(struct dio_viewpoint *viewpoint, const struct dio_pose *pose,
			 uint64_t taken_ns, uint64_t now_ns)
{
	viewpoint->tracked = *pose;
	viewpoint->taken_ns = taken_ns;
	viewpoint->tracked_ns = now_ns;
}

void dio_viewpoint_turn(struct dio_viewpoint *viewpoint, double azimuth, double elevation,
			double notches)
{
	viewpoint->by_hand = true;
	dio_eye_turn(&viewpoint->eye, azimuth, elevation, notches);
}

void dio_viewpoint_follow(struct dio_viewpoint *viewpoint)
{
	dio_eye_reset(&viewpoint->eye.orbit, &viewpoint->eye);
	viewpoint->by_hand = false;
}

/* The pose at a time of a path that starts over at its end: the last one not later. */
static void pose_at(const struct dio_trajectory *path, double time_s, struct dio_pose *pose)
{
	double start = path->time_s[0], length = path->time_s[path->count - 1] - start;
	double at = start + (length > 0 ? fmod(time_s, length) : 0);
	uint32_t low = 0, high = path->count - 1;

	while (low < high) {
		uint32_t middle = low + (high - low + 1) / 2;

		if (path->time_s[middle] <= at)
			low = middle;
		else
			high = middle - 1;
	}
	*pose = path->poses[low];
}

static bool is_tracked(const struct dio_viewpoint *viewpoint, uint64_t now_ns)
{
	return viewpoint->tracked_ns != 0 && now_ns < viewpoint->tracked_ns + DIO_VIEWPOINT_LOST_NS;
}

enum dio_viewpoint_source dio_viewpoint_get(struct dio_viewpoint *viewpoint, uint64_t now_ns,
					    struct dio_pose *pose, uint64_t *taken_ns)
{
	double seconds = (double)(now_ns - viewpoint->began_ns) * 1e-9;

	*taken_ns = 0;
	if (viewpoint->by_hand) {
		dio_eye_pose(&viewpoint->eye, pose);
		return DIO_VIEWPOINT_HAND;
	}
	if (viewpoint->playing && viewpoint->path.count > 0) {
		pose_at(&viewpoint->path, seconds, pose);
		return DIO_VIEWPOINT_PATH;
	}
	if (!viewpoint->playing && is_tracked(viewpoint, now_ns)) {
		*pose = viewpoint->tracked;
		*taken_ns = viewpoint->taken_ns;
		viewpoint->began_ns = now_ns; /* an orbit begins when tracking is lost */
		return DIO_VIEWPOINT_TRACKED;
	}
	pose_at(&viewpoint->orbit, seconds, pose);
	return DIO_VIEWPOINT_ORBIT;
}

void dio_viewpoint_deinit(struct dio_viewpoint *viewpoint)
{
	dio_trajectory_deinit(&viewpoint->orbit);
	dio_trajectory_deinit(&viewpoint->path);
	*viewpoint = (struct dio_viewpoint){0};
}
