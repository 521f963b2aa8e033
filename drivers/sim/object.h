/* Makers of things. Each puts primitives into a thing that was begun, of about `s` metres (half of
 * its largest side), and returns the radius of its base. */
#ifndef DIO_SIM_OBJECT_H
#define DIO_SIM_OBJECT_H

#include "build.h"

/** Stones, lumps, bread: one or a heap. */
float sim_make_rocks(struct builder *b, float s);
/** A slab with a landscape on top: tiles, fields, ornaments, cakes. */
float sim_make_relief(struct builder *b, float s);
/** Blocks, balls and drums with something cut out of them. */
float sim_make_carved(struct builder *b, float s);
/** Nuts, washers, rolls of tape. */
float sim_make_rings(struct builder *b, float s);
/** A pot with leaves. */
float sim_make_plant(struct builder *b, float s);
/** Glasses, jars, bottles with a label, cases with something inside. */
float sim_make_glassware(struct builder *b, float s);
/** A table lamp that is lit. */
float sim_make_lamp(struct builder *b, float s);
/** Thin bars in a row: racks, cages, fences, combs. */
float sim_make_rack(struct builder *b, float s);
/** Bent wires, handles, hoses. */
float sim_make_wires(struct builder *b, float s);
/** A chair or stool. */
float sim_make_chair(struct builder *b, float s);
/** A framed mirror or picture, leaning back. */
float sim_make_frame(struct builder *b, float s);
/** A figure of rounded lumps on a plinth. */
float sim_make_figure(struct builder *b, float s);

#endif
