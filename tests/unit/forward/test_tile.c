/* Views cut into tiles: every token in one of them, at a place of its own. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "forward/tile.h"
#include "forward/workspace.h"
#include "kernels/pack.h"
#include "support/random.h"

enum { MOST_VIEWS = 12, MOST_TOKENS = 700, MOST_THREADS = 9, ROUNDS = 3000, TILE_MOST = 256 };

struct world {
	size_t first_token[MOST_VIEWS + 1];
	struct dvsm_group group;
	size_t rows; /* of the workspace, as much as a group of these views is given */
	struct dvsm_cut cut;
	size_t seen_tokens, next_row;
	uint32_t
		views_met[MOST_VIEWS * MOST_TOKENS]; /* by token: the view that a part named, + 1 */
	size_t row_of[MOST_VIEWS * MOST_TOKENS];
};

static size_t draw_tokens(struct support_random *random, size_t alike)
{
	/* Many whole strips: only with them can views in tiles lie side by side. */
	size_t tokens = 1 + support_random_below(random, MOST_TOKENS);

	if (alike == 0)
		return tokens;
	return alike == 1 ? 256 : (tokens + 31) / 32 * 32 - (tokens > 672 ? 32 : 0);
}

static void draw(struct support_random *random, struct world *world)
{
	const size_t alike = support_random_below(random, 3);
	const uint32_t views = 1 + (uint32_t)support_random_below(random, MOST_VIEWS);

	memset(world, 0, sizeof(*world));
	world->first_token[0] = support_random_below(random, 1000);
	for (uint32_t v = 0; v < views; v++) {
		size_t tokens = draw_tokens(random, alike);

		world->first_token[v + 1] = world->first_token[v] + tokens;
		world->rows += dvsm_group_rows(tokens);
	}
	world->group = (struct dvsm_group){world->first_token, views};
	world->cut = dvsm_cut_make(&world->group, 1 + support_random_below(random, MOST_THREADS),
				   support_random_below(random, 2) == 1);
}

/* Tokens of one view in a tile. */
static void meet_part(struct world *world, const struct dvsm_tile *tile,
		      const struct dvsm_tile_part *part)
{
	const size_t base = world->first_token[0], view_token = world->first_token[part->view];

	assert_true(part->view < world->group.views);
	assert_int_equal(part->view_tokens, dvsm_group_tokens(&world->group, part->view));
	assert_true(part->first + part->rows <= part->view_tokens);
	assert_int_equal(view_token + part->first, tile->token + part->at);
	assert_int_equal(part->view_row + part->first, tile->row + part->at);
	if (world->cut.strips)
		assert_int_equal(part->view_row % DVSM_TILE_ROWS, 0);
	for (size_t i = 0; i < part->rows; i++) {
		const size_t token = view_token + part->first + i - base;

		assert_int_equal(world->views_met[token], 0);
		world->views_met[token] = part->view + 1;
		world->row_of[token] = part->view_row + part->first + i;
		world->seen_tokens++;
	}
}

static void meet_tile(struct world *world, const struct dvsm_tile *tile)
{
	struct dvsm_tile_part part = dvsm_tile_first_part(&world->cut, tile);
	size_t rows = 0;

	assert_in_range(tile->rows, 1, TILE_MOST);
	assert_int_equal(part.view, tile->view);
	assert_int_equal(part.first, tile->first);
	assert_true(tile->row >= world->next_row);
	assert_true(tile->row + tile->rows <= world->rows);
	if (world->cut.strips)
		assert_int_equal(tile->row % DVSM_TILE_ROWS, 0);
	world->next_row = tile->row + tile->rows;
	for (; part.rows > 0; dvsm_tile_next_part(&world->cut, tile, &part)) {
		assert_int_equal(part.at, rows);
		rows += part.rows;
		meet_part(world, tile, &part);
	}
	assert_int_equal(rows, tile->rows);
}

static void every_token_is_in_one_tile(void **state)
{
	static struct world world;
	struct support_random random = support_random_seeded("engine_tile");
	size_t side_by_side = 0;

	(void)state;
	for (int round = 0; round < ROUNDS; round++) {
		draw(&random, &world);
		for (size_t i = 0; i < dvsm_cut_count(&world.cut); i++) {
			const struct dvsm_tile tile = dvsm_cut_find(&world.cut, i);

			meet_tile(&world, &tile);
		}
		assert_int_equal(world.seen_tokens,
				 world.first_token[world.group.views] - world.first_token[0]);
		for (size_t token = 1; token < world.seen_tokens; token++)
			assert_true(world.row_of[token] > world.row_of[token - 1]);
		side_by_side += world.cut.dense > 0 && world.cut.strips;
	}
	assert_true(side_by_side > 0);
}

static void threads_share_the_tiles_of_a_view_alike(void **state)
{
	static const size_t FIRST_TOKEN[] = {0, 256};
	const struct dvsm_group group = {FIRST_TOKEN, 1};

	(void)state;
	for (size_t threads = 1; threads <= 8; threads++) {
		const struct dvsm_cut cut = dvsm_cut_make(&group, threads, true);

		/* 256 tokens are eight whole steps of 32: as many tiles as share them evenly. */
		assert_true(dvsm_cut_count(&cut) <= threads);
		assert_int_equal(dvsm_cut_find(&cut, 0).rows,
				 dvsm_group_rows((256 + threads - 1) / threads));
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_token_is_in_one_tile),
		cmocka_unit_test(threads_share_the_tiles_of_a_view_alike),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
