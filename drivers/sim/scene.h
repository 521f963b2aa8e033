/* What a scene is made of. Plain data without pointers, so it can be copied to any device. */
#ifndef DIO_SIM_SCENE_H
#define DIO_SIM_SCENE_H

#include "dio/sim.h"
#include "photo.h"
#include "rng.h"
#include "vec.h"

enum {
	SIM_MAX_PRIMS = 192,
	SIM_SET_WORDS = SIM_MAX_PRIMS / 64,
	SIM_MAX_THINGS = 48,
	SIM_MAX_LIGHTS = 3,
};

enum texture_kind {
	TEX_PLAIN,
	TEX_CHECKS,
	TEX_STRIPES,
	TEX_NOISE,
	TEX_BLOTCHES,
	TEX_MARBLE,
	TEX_WOOD,
	TEX_CELLS,
	TEX_TILES,
	TEX_DOTS,
	TEX_PRINT,
	TEX_GRADIENT,
	TEX_FACADE,
	TEX_WEAVE,
	TEX_MOTIF,
	TEX_PICTURE,
	TEX_PHOTO, /* see photo.h */
	TEX_COUNT,
};

struct material {
	enum texture_kind texture;
	uint32_t seed;
	float scale; /* texture periods per metre */
	float turn_cos, turn_sin;
	float grime;         /* strength of large-scale brightness variation */
	float specular;      /* reflectance at normal incidence, 0: matt */
	uint32_t gloss_log2; /* highlight exponent is 2^this */
	bool reflects;       /* trace one bounce */
	float clear;         /* share of the light that goes straight through */
	struct v3 tint;      /* of that light */
	float emission;
	struct v3 colour[4]; /* linear */
};

enum shape {
	SHAPE_BOX,
	SHAPE_ELLIPSOID,
	SHAPE_CYLINDER,  /* axis z, radius half.x, half height half.z */
	SHAPE_FRUSTUM,   /* axis z, radius half.x below, `extra` above, half height half.z */
	SHAPE_TORUS,     /* axis z, ring radius half.x, tube radius half.y */
	SHAPE_ROUND_BOX, /* `extra` is the edge radius */
	SHAPE_CUP,       /* open-topped cylinder, wall thickness `extra` */
	SHAPE_PEBBLE,    /* ellipsoid under a smooth deformation of depth `extra` */
	SHAPE_ARC,       /* part of a torus: half.x ring, half.y tube, `extra` half angle, turns */
	SHAPE_ROCK,      /* ellipsoid with dents of depth `extra`, `wave` of them to its radius */
	SHAPE_RELIEF,    /* box with a landscape cut into its top, `extra` of half.z at most */
	SHAPE_CARVED,    /* `solid` with `cut` of size `extra` taken away */
};

enum solid {
	SOLID_BOX,
	SOLID_BALL,
	SOLID_DRUM,
};

/* What is taken away from a solid; `extra` is its radius or half width. */
enum cut {
	CUT_DIP,     /* a ball about the middle of the top */
	CUT_BORE,    /* a hole from top to bottom */
	CUT_SLOT,    /* a channel along x, down to the middle */
	CUT_CORNERS, /* a ball about each upper corner */
	CUT_FLUTES,  /* grooves from top to bottom across the two long sides */
};

struct prim {
	enum shape shape;
	struct v3 centre, half;
	float extra;
	struct v3 inv;            /* 1 / half */
	float turn_cos, turn_sin; /* of `extra` turns */
	enum solid solid;         /* of SHAPE_CARVED */
	enum cut cut;
	float wave;      /* dents or hills per metre, or per radius */
	float caution;   /* bound on how fast the field of dents and hills changes, inverted */
	float bound;     /* radius of the bounding sphere about `centre` */
	struct v3 reach; /* half sides of the bounding box in its own frame */
	bool round;      /* it lies within the ellipsoid of that reach */
	struct rotation rot;
	struct material material;
};

/* What rules a primitive out, apart from the rest of it: many are looked at, few are met. */
struct bound {
	struct v3 centre;
	float radius, top;
};

/* Neighbouring primitives with one bounding sphere. */
struct thing {
	uint32_t first, count;
};

struct light {
	bool directional;
	struct v3 at; /* direction to a far light (unit), or its position */
	float size;   /* tangent of its angular radius, or radius in metres */
	struct v3 colour;
};

enum surround {
	SURROUND_SKY,   /* gradient, clouds */
	SURROUND_ROOM,  /* inside of a box */
	SURROUND_PLAIN, /* one colour everywhere */
};

struct dio_sim_scene {
	uint64_t seed;
	enum dio_sim_kind kind;

	enum surround surround;
	struct v3 sky[3]; /* horizon, zenith, cloud; `plain` uses the first */
	float clouds;
	struct v3 room_lo, room_hi;
	struct material wall[6]; /* -x +x -y +y -z +z */

	bool has_ground;
	float ground_z;
	struct material ground;

	struct dio_sim_board board;
	float paper_half_x, paper_half_y; /* 0: no board */

	uint32_t light_count;
	struct light light[SIM_MAX_LIGHTS];
	struct v3 ambient_up, ambient_down; /* light from above and, bounced, from below */

	uint32_t prim_count, thing_count;
	struct prim prim[SIM_MAX_PRIMS];
	struct bound bound[SIM_MAX_PRIMS];
	uint64_t clear[SIM_SET_WORDS]; /* bits of those that let light through */
	struct thing thing[SIM_MAX_THINGS];

	/* Bounds of the things as arrays, for loops that test all at once: a box along the axes,
	 * its centre and the radius of its sphere. */
	float lo_x[SIM_MAX_THINGS], lo_y[SIM_MAX_THINGS], lo_z[SIM_MAX_THINGS];
	float hi_x[SIM_MAX_THINGS], hi_y[SIM_MAX_THINGS], hi_z[SIM_MAX_THINGS];
	float mid_x[SIM_MAX_THINGS], mid_y[SIM_MAX_THINGS], mid_z[SIM_MAX_THINGS];
	float radius[SIM_MAX_THINGS];
	float occluder2[SIM_MAX_THINGS]; /* squared radius of the ball that shades as much */

	struct sim_photos photos;

	float exposure; /* the gain that a camera's automatic exposure would choose */

	/* What a camera should look at. */
	struct v3 focus;
	float extent; /* radius of what matters around the focus */
};

#endif
