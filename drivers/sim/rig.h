/* How somebody took the pictures of a scene: the spread of cameras for training. */
#ifndef DIO_SIM_RIG_H
#define DIO_SIM_RIG_H

#include "scene.h"

enum rig_style {
	RIG_RING,    /* round about, at one height */
	RIG_DOME,    /* over a part of a sphere */
	RIG_FORWARD, /* side by side, looking the same way */
	RIG_WALK,    /* along a path, turning while walking */
};

struct rig {
	enum rig_style style;
	float turn, turn_span;     /* direction from focus to camera and its spread, turns */
	float height, height_span; /* elevation, turns */
	float away, away_span;     /* distance, and its relative spread */
	float aim_jitter;          /* metres by which the aim wanders */
	float roll, roll_span;     /* turns */
	struct v3 aim;
	double fx, fy, cx, cy;
};

/** Draw a rig that suits the scene, for pictures of this size. */
struct rig sim_rig_draw(const struct dio_sim_scene *scene, struct rng *rng, uint32_t width,
			uint32_t height);

/** Camera of one view; `along` in [0,1] is its place on the path. */
void sim_rig_camera(const struct dio_sim_scene *scene, const struct rig *rig, struct rng *rng,
		    float along, uint32_t width, uint32_t height, struct dio_sim_camera *camera);

#endif
