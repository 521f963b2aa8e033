/* The kernels' steps draw the pictures of the CPU's tracer: walked through by the CPU always, by a
 * GPU where there is one. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "dio/sim_cuda.h"

/* Sides that are no multiple of a tile or of a square of JPEG. */
enum { SCENES = 24, VIEWS = 3, WIDTH = 44, HEIGHT = 27, VALUES = WIDTH * HEIGHT * 3 };

static uint8_t want[SCENES * VIEWS * VALUES], got[SCENES * VIEWS * VALUES];
static float want_floats[VIEWS * VALUES], got_floats[VIEWS * VALUES];
static float poses[SCENES * VIEWS * 16], intrinsics[SCENES * VIEWS * 4];
static float other_poses[SCENES * VIEWS * 16], other_intrinsics[SCENES * VIEWS * 4];

static void steps_on_the_host_give_the_tracers_bytes(void **state)
{
	(void)state;
	assert_int_equal(
		dio_sim_batch(300, SCENES, VIEWS, WIDTH, HEIGHT, 0, want, poses, intrinsics), 0);
	assert_int_equal(dio_sim_batch_cuda_on_host(300, SCENES, VIEWS, WIDTH, HEIGHT, 0, got,
						    other_poses, other_intrinsics),
			 0);
	assert_memory_equal(want, got, sizeof(want));
	assert_memory_equal(poses, other_poses, sizeof(poses));
	assert_memory_equal(intrinsics, other_intrinsics, sizeof(intrinsics));
}

static void floats_agree_too(void **state)
{
	const uint32_t options = DIO_SIM_BATCH_FLOAT | DIO_SIM_BATCH_TABLES;

	(void)state;
	assert_int_equal(
		dio_sim_batch(7, 1, VIEWS, WIDTH, HEIGHT, options, want_floats, poses, intrinsics),
		0);
	assert_int_equal(dio_sim_batch_cuda_on_host(7, 1, VIEWS, WIDTH, HEIGHT, options, got_floats,
						    poses, intrinsics),
			 0);
	assert_memory_equal(want_floats, got_floats, sizeof(want_floats));
}

static void sizes_of_zero_are_refused(void **state)
{
	(void)state;
	assert_int_equal(
		dio_sim_batch_cuda_on_host(1, 1, 0, WIDTH, HEIGHT, 0, got, poses, intrinsics), -1);
	assert_int_equal(
		dio_sim_batch_cuda(0, 1, 1, VIEWS, 0, HEIGHT, 0, NULL, poses, intrinsics, 1, NULL),
		-1);
}

static void a_missing_gpu_is_a_fault_with_a_reason(void **state)
{
	(void)state;
	if (dio_sim_cuda_devices() > 0) {
		print_message("skipped: there is a GPU\n");
		skip();
	}
	assert_int_equal(dio_sim_batch_cuda(0, 1, 1, VIEWS, WIDTH, HEIGHT, 0, NULL, poses,
					    intrinsics, 1, NULL),
			 -2);
	assert_true(strlen(dio_sim_cuda_fault()) > 4);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(steps_on_the_host_give_the_tracers_bytes),
		cmocka_unit_test(floats_agree_too),
		cmocka_unit_test(sizes_of_zero_are_refused),
		cmocka_unit_test(a_missing_gpu_is_a_fault_with_a_reason),
	};

	return cmocka_run_group_tests_name("sim_cuda", tests, NULL, NULL);
}
