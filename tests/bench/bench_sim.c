/* How fast training scenes are drawn: bench_sim [SCENES [WIDTH [HEIGHT]]].
 *
 * For each kind of scene, and for the mixture that training draws: pictures for each second that
 * one core works (processor time, so that other work on the machine does little harm). Every call
 * is what a trainer calls: whole scenes of 12 views, building them included, as bytes after the
 * sensor. The scenes are always the same ones. `taskset -c 0 build/bin/bench_sim` */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "dio/sim_batch.h"

enum { VIEWS = 12, MAX_SIDE = 1024 };

static double worked_s(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Pictures a second; a negative number when the generator fails. */
static double rate(uint32_t options, uint32_t scenes, uint32_t width, uint32_t height, uint8_t *rgb)
{
	float poses[VIEWS * 16], intrinsics[VIEWS * 4];
	double start = worked_s();

	for (uint32_t i = 0; i < scenes; i++)
		if (dio_sim_batch(9000 + i, 1, VIEWS, width, height, options, rgb, poses,
				  intrinsics))
			return -1;
	return scenes * VIEWS / (worked_s() - start);
}

static long argument(int argc, char **argv, int place, long otherwise)
{
	return argc > place ? strtol(argv[place], NULL, 10) : otherwise;
}

int main(int argc, char **argv)
{
	static const struct {
		const char *name;
		uint32_t options;
	} rows[] = {
		{"tables", DIO_SIM_BATCH_TABLES},
		{"rooms", DIO_SIM_BATCH_ROOMS},
		{"turntables", DIO_SIM_BATCH_TURNTABLES},
		{"streets", DIO_SIM_BATCH_STREETS},
		{"all, perfect sensor", DIO_SIM_BATCH_CLEAN},
		{"all", 0},
	};
	long scenes = argument(argc, argv, 1, 96), width = argument(argc, argv, 2, 64);
	long height = argument(argc, argv, 3, width);
	uint8_t *rgb;

	if (scenes < 1 || width < 1 || height < 1 || width > MAX_SIDE || height > MAX_SIDE) {
		fprintf(stderr, "bench_sim: want SCENES >= 1 and sides of 1..%d pixels\n",
			MAX_SIDE);
		return 2;
	}
	rgb = malloc((size_t)VIEWS * (size_t)width * (size_t)height * 3);
	printf("%ld x %ld pixels, %d views a scene, one thread, %ld scenes a row\n", width, height,
	       VIEWS, scenes);
	for (size_t i = 0; rgb && i < sizeof(rows) / sizeof(rows[0]); i++) {
		double r = rate(rows[i].options, (uint32_t)scenes, (uint32_t)width,
				(uint32_t)height, rgb);

		if (r < 0) {
			free(rgb);
			rgb = NULL;
			break;
		}
		printf("%-20s %7.0f pictures/s\n", rows[i].name, r);
		fflush(stdout);
	}
	if (!rgb) {
		fprintf(stderr, "bench_sim: no memory for pictures of this size\n");
		return 1;
	}
	free(rgb);
	return 0;
}
