/* Putting scenes together: primitives, things, materials, lights. Build time only. */
#ifndef DIO_SIM_BUILD_H
#define DIO_SIM_BUILD_H

#include "scene.h"

/* Rotations. Angles in turns. */
struct rotation sim_turned(float yaw);
struct rotation sim_tumbled(float yaw, float pitch, float roll);

/* A thing in the making: primitives are placed in its own frame, z up, base at z = 0. */
struct builder {
	struct dio_sim_scene *scene;
	struct rng *rng;
	struct v3 origin;
	struct rotation turn;
	uint32_t first;
};

/** Start a thing at `origin`; false when the scene is full. */
bool sim_thing_begin(struct builder *b, struct dio_sim_scene *scene, struct rng *rng,
		     struct v3 origin, struct rotation turn);
/** Finish it: bounding sphere, occlusion ball. `casts_ambient` false for large flat things. */
void sim_thing_end(struct builder *b, bool casts_ambient);

/** Add a primitive at `centre` of the thing's frame; NULL when full. */
struct prim *sim_add(struct builder *b, enum shape shape, struct v3 centre, struct v3 half,
		     float extra, const struct material *material);
/** The same, turned within the thing. */
struct prim *sim_add_turned(struct builder *b, enum shape shape, struct v3 centre, struct v3 half,
			    float extra, struct rotation turn, const struct material *material);

/** An ellipsoid with dents of `depth` (of its radius), `wave` of them to a radius. */
struct prim *sim_add_rock(struct builder *b, struct v3 centre, struct v3 half, float depth,
			  float wave, const struct material *material);
/** A box whose top is a landscape with some `hills` across, at most `depth` of half.z deep. */
struct prim *sim_add_relief(struct builder *b, struct v3 centre, struct v3 half, float depth,
			    float hills, struct rotation turn, const struct material *material);
/** A solid with something taken away, see enum cut. */
struct prim *sim_add_carved(struct builder *b, enum solid solid, enum cut cut, struct v3 centre,
			    struct v3 half, float size, const struct material *material);

/* Colours, linear. */
struct v3 sim_colour_any(struct rng *r);
struct v3 sim_colour_wood(struct rng *r);
struct v3 sim_colour_neutral(struct rng *r);
struct v3 sim_colour_vivid(struct rng *r);
struct v3 sim_hsv(float hue, float saturation, float value);
/** Hue, saturation and value between those of two corners. */
struct v3 sim_hsv_in(struct rng *r, struct v3 lo, struct v3 hi);

/** A material whose pattern repeats about every `period_m`. */
struct material sim_material(struct rng *r, enum texture_kind texture, float period_m);
/** For a thing of about `size_m`. */
struct material sim_material_any(struct rng *r, float size_m);
/** For a table top, floor or ground seen from `size_m` away. */
struct material sim_material_floor(struct rng *r, float size_m);
struct material sim_material_wall(struct rng *r, float size_m);
struct material sim_material_plain(struct v3 colour);
/** Glass or clear plastic, colourless or tinted. */
struct material sim_material_glass(struct rng *r);

/** A random thing of radius about `size` standing at `origin`; returns its base radius, 0 when
 * the scene is full. */
float sim_object_add(struct dio_sim_scene *scene, struct rng *rng, struct v3 origin, float size);

/** Lights for a scene of `extent` metres. */
void sim_lights_indoor(struct dio_sim_scene *scene, struct rng *rng);
void sim_lights_outdoor(struct dio_sim_scene *scene, struct rng *rng);

/** The scenes. */
void sim_build_table(struct dio_sim_scene *scene, struct rng *rng, bool clear_board);
void sim_build_room(struct dio_sim_scene *scene, struct rng *rng);
void sim_build_turntable(struct dio_sim_scene *scene, struct rng *rng);
void sim_build_street(struct dio_sim_scene *scene, struct rng *rng);

#endif
