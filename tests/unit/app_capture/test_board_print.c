/* Boards for the printer: every length on the rendered page is what the specification says. */
#include "unit/app/fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dio/board.h"

#define CHARUCO   "charuco:10x7:0.0285:0.0171:DICT_6X6_250"
#define DPI       300
#define PX_PER_MM (DPI / 25.4)

static struct fixture_run run;

static bool have_pdftoppm(void)
{
	fixture_program(&run, "pdftoppm", "-v", NULL);
	if (run.code == 0)
		return true;
	print_message("skipped: pdftoppm is not installed (Debian: poppler-utils)\n");
	return false;
}

/* Print a board and read the page as a picture at DPI. */
static void print_page(const char *spec, const char *paper, const char *kind,
		       struct dio_picture *page)
{
	char out[FIXTURE_PATH_SIZE], png[FIXTURE_PATH_SIZE];
	struct dio_error error = {""};

	snprintf(out, sizeof out, "%s.%s", fixture_path("board"), kind);
	snprintf(png, sizeof png, "%s.png", fixture_path("board"));
	fixture_diorama(&run, "board", "print", spec, "--paper", paper, "--out", out, NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	if (strcmp(kind, "pdf") == 0) {
		fixture_program(&run, "pdftoppm", "-r", "300", "-png", "-singlefile", out,
				fixture_path("board"), NULL);
		assert_int_equal(run.code, 0);
	}
	if (dio_picture_read(png, page, &error) != DIO_OK)
		fail_msg("%s", error.text);
}

static void find_corners(const char *spec, const struct dio_picture *page,
			 struct dio_corners *corners)
{
	struct dio_board_detector *detector;
	struct dio_error error = {""};
	struct dio_board board;

	assert_int_equal(dio_board_parse(spec, &board, &error), DIO_OK);
	assert_int_equal(dio_board_detector_create(&board, &detector, &error), DIO_OK);
	assert_int_equal(dio_board_detect(detector, page, corners, &error), DIO_OK);
	dio_board_detector_destroy(detector);
}

/* Every corner found, and each where the first corner, the square and the resolution put it. */
static void expect_true_size(const char *spec, const struct dio_picture *page, uint32_t count,
			     double square_mm)
{
	struct dio_corners corners = {0};
	double worst = 0;

	find_corners(spec, page, &corners);
	assert_int_equal(corners.count, count);
	for (uint32_t i = 1; i < corners.count; i++) {
		double px[2];

		for (int k = 0; k < 2; k++) {
			double squares = (corners.board_m[i][k] - corners.board_m[0][k]) /
					 (square_mm / 1000);

			px[k] = (double)(corners.image_px[i][k] - corners.image_px[0][k]) -
				squares * square_mm * PX_PER_MM;
		}
		worst = fmax(worst, hypot(px[0], px[1]));
	}
	print_message("%s: worst corner %.3f px = %.4f mm off\n", spec, worst, worst / PX_PER_MM);
	/* pdftoppm moves each edge to a whole pixel. */
	assert_true(worst < 1);
	dio_corners_deinit(&corners);
}

/* Lengths of the black and white runs along one row of the page between the outermost blacks. */
static uint32_t measure_runs(const struct dio_picture *page, uint32_t y, double *runs,
			     uint32_t room)
{
	double last = -1;
	uint32_t count = 0;

	for (uint32_t x = 1; x < page->width; x++) {
		double a = page->rgb[3 * ((size_t)y * page->width + x - 1)] / 255.0;
		double b = page->rgb[3 * ((size_t)y * page->width + x)] / 255.0;
		double at;

		if ((a < 0.5) == (b < 0.5))
			continue;
		/* The grey of an edge pixel says where in it the edge lies. */
		at = x - 0.5 + (0.5 - a) / (b - a);
		if (last >= 0 && count < room)
			runs[count++] = at - last;
		last = at;
	}
	return count;
}

static void a_printed_chessboard_has_squares_of_the_size_it_states(void **state)
{
	struct dio_picture page = {0};
	double runs[64];
	uint32_t count;

	(void)state;
	if (!have_pdftoppm())
		skip();
	print_page("chessboard:9x6:0.025", "A4", "pdf", &page);
	assert_int_equal(page.width, 3508);
	assert_in_range(page.height, 2480, 2481); /* 2480.3 */
	/* Through the middle of the fourth row of squares, which begins with white: nine runs lie
	 * between ten squares' edges. */
	count = measure_runs(&page, (uint32_t)((13.05 + 3.5 * 25) * PX_PER_MM), runs, 64);
	assert_int_equal(count, 9);
	for (uint32_t i = 0; i < count; i++)
		if (fabs(runs[i] - 25 * PX_PER_MM) > 1.01)
			fail_msg("square %u is %.2f px wide, %.2f are due", i, runs[i],
				 25 * PX_PER_MM);
	expect_true_size("chessboard:9x6:0.025", &page, 54, 25);
	dio_picture_deinit(&page);
}

static void a_pdf_board_is_found_at_its_true_size(void **state)
{
	struct dio_picture page = {0};

	(void)state;
	if (!have_pdftoppm())
		skip();
	print_page(CHARUCO, "A4", "pdf", &page);
	expect_true_size(CHARUCO, &page, 54, 28.5);
	dio_picture_deinit(&page);
	print_page("charuco:6x8:0.03:0.022:DICT_4X4_50:legacy", "A4", "pdf", &page);
	expect_true_size("charuco:6x8:0.03:0.022:DICT_4X4_50:legacy", &page, 35, 30);
	dio_picture_deinit(&page);
}

static void a_png_board_is_found_at_its_true_size(void **state)
{
	struct dio_picture page = {0};

	(void)state;
	print_page(CHARUCO, "A3", "png", &page);
	assert_int_equal(page.width, 4961);
	assert_int_equal(page.height, 3508);
	expect_true_size(CHARUCO, &page, 54, 28.5);
	dio_picture_deinit(&page);
}

static void a_png_states_its_resolution(void **state)
{
	static const unsigned char PHYS[] = {'p',  'H', 'Y', 's',  0,    0, 0x2e,
					     0x23, 0,   0,   0x2e, 0x23, 1};
	unsigned char head[64];
	FILE *file;

	(void)state;
	fixture_diorama(&run, "board", "print", CHARUCO, "--out", fixture_path("dpi.png"), NULL);
	assert_int_equal(run.code, 0);
	file = fopen(fixture_path("dpi.png"), "rb");
	assert_non_null(file);
	assert_int_equal(fread(head, 1, sizeof head, file), sizeof head);
	fclose(file);
	assert_non_null(memmem(head, sizeof head, PHYS, sizeof PHYS));
}

static void a_board_larger_than_the_paper_is_refused_with_what_would_do(void **state)
{
	(void)state;
	fixture_diorama(&run, "board", "print", CHARUCO, "--paper", "A5", "--out",
			fixture_path("x.pdf"), NULL);
	fixture_expect_refusal(&run, 1, "285.0 x 199.5 mm|A5|--paper A4|squares of at most 0.0196");
	fixture_diorama(&run, "board", "print", "chessboard:9x6:0.3", "--out",
			fixture_path("x.pdf"), NULL);
	fixture_expect_refusal(&run, 1, "3000.0 x 2100.0 mm|any paper");
	assert_int_not_equal(access(fixture_path("x.pdf"), F_OK), 0);
}

static void bad_requests_are_told_in_one_line(void **state)
{
	(void)state;
	fixture_diorama(&run, "board", "print", "charuco:10x", "--out", fixture_path("x.pdf"),
			NULL);
	fixture_expect_refusal(&run, 1, "charuco:10x");
	fixture_diorama(&run, "board", "print", CHARUCO, "--out", fixture_path("x.svg"), NULL);
	fixture_expect_refusal(&run, 1, "x.svg|.pdf or .png");
	fixture_diorama(&run, "board", "print", CHARUCO, "--out", fixture_path("no/x.pdf"), NULL);
	fixture_expect_refusal(&run, 1, "no/x.pdf");
	fixture_diorama(&run, "board", "print", CHARUCO, "--paper", "A9", "--out",
			fixture_path("x.pdf"), NULL);
	fixture_expect_refusal(&run, 1, "A9|letter");
	fixture_diorama(&run, "board", "print", CHARUCO, NULL);
	fixture_expect_refusal(&run, 2, "--out FILE is missing");
	fixture_diorama(&run, "board", "fold", CHARUCO, NULL);
	fixture_expect_refusal(&run, 2, "fold|--help");
}

static void a_full_disk_is_told(void **state)
{
	static const char *const NAMES[] = {"full.pdf", "full.png"};

	(void)state;
	for (int i = 0; i < 2; i++) {
		assert_int_equal(symlink("/dev/full", fixture_path(NAMES[i])), 0);
		fixture_diorama(&run, "board", "print", CHARUCO, "--out", fixture_path(NAMES[i]),
				NULL);
		fixture_expect_refusal(&run, 1, "space");
		fixture_expect_refusal(&run, 1, NAMES[i]);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_printed_chessboard_has_squares_of_the_size_it_states),
		cmocka_unit_test(a_pdf_board_is_found_at_its_true_size),
		cmocka_unit_test(a_png_board_is_found_at_its_true_size),
		cmocka_unit_test(a_png_states_its_resolution),
		cmocka_unit_test(a_board_larger_than_the_paper_is_refused_with_what_would_do),
		cmocka_unit_test(bad_requests_are_told_in_one_line),
		cmocka_unit_test(a_full_disk_is_told),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
