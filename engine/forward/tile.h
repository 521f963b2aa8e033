/*
 * How the tokens of a group of views are cut into tiles, each of which one thread takes through a
 * part of a layer. Private to engine/forward.
 */
#ifndef DVSM_FORWARD_TILE_H
#define DVSM_FORWARD_TILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "geometry/group.h"

/** A group, cut. */
struct dvsm_cut {
	const struct dvsm_group *group;
	size_t threads;
	bool strips;  /* every view begins with a whole strip of DVSM_TILE_ROWS rows */
	size_t dense; /* rows of the group where its views lie side by side; 0 where they do not */
};

/** Tokens of one view, or of several. */
struct dvsm_tile {
	size_t row, token; /* the first one in the workspace, and in the residual stream */
	size_t rows;
	uint32_t view; /* of the first one */
	size_t first;  /* which of that view's tokens it is */
};

/** Those of a tile that are one view's. */
struct dvsm_tile_part {
	size_t at, rows; /* among the tile's */
	uint32_t view;
	size_t first;                 /* which of the view's tokens the first one is */
	size_t view_row, view_tokens; /* of the view: first row in the workspace, tokens */
};

struct dvsm_cut dvsm_cut_make(const struct dvsm_group *group, size_t threads, bool strips);

/** How many tiles there are. */
size_t dvsm_cut_count(const struct dvsm_cut *cut);

/** One of them; index below their number. */
struct dvsm_tile dvsm_cut_find(const struct dvsm_cut *cut, size_t index);

/** Rows of the workspace that a view of so many tokens takes. */
size_t dvsm_cut_rows_of(const struct dvsm_cut *cut, size_t tokens);

/** The tile's rows of its first view; then of the next one, none when rows is 0. */
struct dvsm_tile_part dvsm_tile_first_part(const struct dvsm_cut *cut,
					   const struct dvsm_tile *tile);
void dvsm_tile_next_part(const struct dvsm_cut *cut, const struct dvsm_tile *tile,
			 struct dvsm_tile_part *part);

#endif
