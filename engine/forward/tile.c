#include "forward/tile.h"

#include "forward/workspace.h"
#include "threads/pool.h"

/* Most tokens of a tile: the hidden numbers of their MLP fit the second-level cache. */
#define TILE_TOKENS 256u

struct dvsm_cut dvsm_cut_make(const struct dvsm_group *group, size_t threads, bool strips)
{
	struct dvsm_cut cut = {.group = group, .threads = threads, .strips = strips};

	for (uint32_t v = 0; strips && v < group->views; v++) {
		size_t tokens = dvsm_group_tokens(group, v);

		if (dvsm_group_rows(tokens) != tokens)
			return cut;
	}
	cut.dense = group->first_token[group->views] - group->first_token[0];
	return cut;
}

size_t dvsm_cut_rows_of(const struct dvsm_cut *cut, size_t tokens)
{
	return cut->strips ? dvsm_group_rows(tokens) : tokens;
}

/* Rows of a tile, of `shares` or multiples of that: the more rows, the less often weights are read.
 */
static size_t share_rows(size_t rows, size_t step)
{
	size_t shares = step;

	while (dvsm_tiles(rows, shares) > TILE_TOKENS)
		shares += step;
	return dvsm_group_rows(dvsm_tiles(rows, shares));
}

/*
 * Tokens of a tile. Where views lie side by side their rows are cut as if they were one; elsewhere
 * each view is cut, unless there are enough whole ones to go round.
 */
static size_t tile_size(const struct dvsm_cut *cut, size_t view_tokens)
{
	if (cut->dense)
		return share_rows(cut->dense, cut->threads);
	return share_rows(view_tokens, cut->group->views % cut->threads == 0 ? 1 : cut->threads);
}

size_t dvsm_cut_count(const struct dvsm_cut *cut)
{
	size_t count = 0;

	if (cut->dense)
		return dvsm_tiles(cut->dense, tile_size(cut, 0));
	for (uint32_t v = 0; v < cut->group->views; v++) {
		size_t tokens = dvsm_group_tokens(cut->group, v);

		count += dvsm_tiles(tokens, tile_size(cut, tokens));
	}
	return count;
}

static struct dvsm_tile find_dense(const struct dvsm_cut *cut, size_t index)
{
	const size_t *first_token = cut->group->first_token;
	const size_t size = tile_size(cut, 0), row = index * size, token = first_token[0] + row;
	uint32_t view = 0;

	while (token >= first_token[view + 1])
		view++;
	return (struct dvsm_tile){row, token, dvsm_tile_length(cut->dense, size, index), view,
				  token - first_token[view]};
}

struct dvsm_tile dvsm_cut_find(const struct dvsm_cut *cut, size_t index)
{
	size_t row = 0;

	if (cut->dense)
		return find_dense(cut, index);
	for (uint32_t v = 0;; v++) {
		size_t tokens = dvsm_group_tokens(cut->group, v), size = tile_size(cut, tokens);
		size_t tiles = dvsm_tiles(tokens, size), first = index * size;

		if (index < tiles)
			return (struct dvsm_tile){row + first, cut->group->first_token[v] + first,
						  dvsm_tile_length(tokens, size, index), v, first};
		index -= tiles;
		row += dvsm_group_rows(tokens);
	}
}

struct dvsm_tile_part dvsm_tile_first_part(const struct dvsm_cut *cut, const struct dvsm_tile *tile)
{
	const size_t tokens = dvsm_group_tokens(cut->group, tile->view);
	const size_t left = tokens - tile->first;

	return (struct dvsm_tile_part){0,
				       tile->rows < left ? tile->rows : left,
				       tile->view,
				       tile->first,
				       tile->row - tile->first,
				       tokens};
}

void dvsm_tile_next_part(const struct dvsm_cut *cut, const struct dvsm_tile *tile,
			 struct dvsm_tile_part *part)
{
	const size_t at = part->at + part->rows, left = tile->rows - at;
	const size_t view_row = part->view_row + dvsm_cut_rows_of(cut, part->view_tokens);

	*part = (struct dvsm_tile_part){.at = at, .view = part->view + 1, .view_row = view_row};
	if (left == 0)
		return;
	part->view_tokens = dvsm_group_tokens(cut->group, part->view);
	part->rows = left < part->view_tokens ? left : part->view_tokens;
}
