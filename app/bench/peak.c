#include "bench/peak.h"

#include <pthread.h>
#include <sched.h>
#include <stdbool.h>
#include <stdlib.h>

#include "dio/clock.h"

#define RUNS        3
#define RUN_NS      40000000u /* long enough for the clock, short enough to find a quiet moment */
#define CHUNK_TURNS 4096u
#define SWEEP_BYTES ((size_t)256 << 20)

static const struct dio_peak_loop *const LOOPS[] = {
	dio_peak_loops_x86,
	dio_peak_loops_amx,
	dio_peak_loops_neon,
	dio_peak_loops_neon_dot,
};

/* Threads that do one thing together, begun when all are there. */
struct team {
	pthread_mutex_t mutex;
	pthread_cond_t decided;
	bool go, give_up;
	const struct dio_peak_loop *loop; /* NULL: sweep over memory */
	const uint64_t *memory;
	size_t words; /* of memory, a thread */
};

struct member {
	struct team *team;
	uint32_t index;
	double rate; /* operations or bytes a second */
};

/* Share the processors out: one each while there are enough. */
static void take_processor(uint32_t index)
{
	cpu_set_t allowed, one;
	uint32_t place;

	if (sched_getaffinity(0, sizeof allowed, &allowed) != 0)
		return;
	place = index % (uint32_t)CPU_COUNT(&allowed);
	CPU_ZERO(&one);
	for (uint32_t cpu = 0; cpu < CPU_SETSIZE; cpu++) {
		if (CPU_ISSET(cpu, &allowed) && place-- == 0) {
			CPU_SET(cpu, &one);
			break;
		}
	}
	/* Where this is refused the system places the thread. */
	(void)sched_setaffinity(0, sizeof one, &one);
}

static double run_loop(const struct dio_peak_loop *loop)
{
	uint64_t start_ns = dio_clock_ns(), spent_ns, chunks = 0;
	volatile float keep;
	float sink = 1;

	do {
		loop->run(CHUNK_TURNS, &sink);
		chunks++;
		spent_ns = dio_clock_ns() - start_ns;
	} while (spent_ns < RUN_NS);
	keep = sink;
	(void)keep;
	return (double)(chunks * CHUNK_TURNS * loop->operations) * 1e9 / (double)spent_ns;
}

static double sweep(const uint64_t *words, size_t count)
{
	uint64_t start_ns = dio_clock_ns(), sums[8] = {0};
	volatile uint64_t keep;

	for (size_t i = 0; i + 8 <= count; i += 8)
		for (size_t k = 0; k < 8; k++)
			sums[k] += words[i + k];
	for (size_t k = 1; k < 8; k++)
		sums[0] += sums[k];
	keep = sums[0];
	(void)keep;
	return (double)(count * sizeof *words) * 1e9 / (double)(dio_clock_ns() - start_ns);
}

static void *work(void *context)
{
	struct member *self = context;
	struct team *team = self->team;
	bool go;

	take_processor(self->index);
	pthread_mutex_lock(&team->mutex);
	while (!team->go && !team->give_up)
		pthread_cond_wait(&team->decided, &team->mutex);
	go = team->go;
	pthread_mutex_unlock(&team->mutex);
	if (go && team->loop)
		self->rate = run_loop(team->loop);
	else if (go)
		self->rate = sweep(team->memory + self->index * team->words, team->words);
	return NULL;
}

/* Sum of the threads' rates; false when not all of them could be started. */
static bool run_members(struct team *team, struct member *members, pthread_t *ids, uint32_t threads,
			double *rate)
{
	uint32_t started = 0;
	bool all;

	team->go = team->give_up = false;
	for (; started < threads; started++) {
		members[started] = (struct member){.team = team, .index = started};
		if (pthread_create(&ids[started], NULL, work, &members[started]) != 0)
			break;
	}
	all = started == threads;
	pthread_mutex_lock(&team->mutex);
	team->go = all;
	team->give_up = !all;
	pthread_cond_broadcast(&team->decided);
	pthread_mutex_unlock(&team->mutex);
	*rate = 0;
	for (uint32_t i = 0; i < started; i++) {
		pthread_join(ids[i], NULL);
		*rate += members[i].rate;
	}
	return all;
}

/* The best of some runs: what disturbs the machine can only slow it down. */
static enum dio_status run_team(struct team *team, uint32_t threads, double *best,
				struct dio_error *error)
{
	struct member *members = calloc(threads, sizeof *members);
	pthread_t *ids = calloc(threads, sizeof *ids);
	bool good = members && ids;
	double rate;

	*best = 0;
	for (int run = 0; good && run < RUNS; run++) {
		good = run_members(team, members, ids, threads, &rate);
		if (good && rate > *best)
			*best = rate;
	}
	free(members);
	free(ids);
	return good ? DIO_OK
		    : dio_fail(error, DIO_NO_MEM, "%u threads to measure with cannot be started",
			       threads);
}

static enum dio_status measure_units(struct team *team, uint32_t cpu, struct dio_peak *peak,
				     struct dio_error *error)
{
	for (size_t i = 0; i < sizeof(LOOPS) / sizeof(LOOPS[0]); i++) {
		for (const struct dio_peak_loop *loop = LOOPS[i]; loop->run; loop++) {
			struct dio_peak_unit *unit = &peak->units[loop->unit];
			enum dio_status status;
			double rate;

			if ((loop->cpu & cpu) != loop->cpu)
				continue;
			team->loop = loop;
			status = run_team(team, peak->threads, &rate, error);
			if (status != DIO_OK)
				return status;
			if (rate > unit->operations_per_s)
				*unit = (struct dio_peak_unit){loop->instruction, rate};
		}
	}
	return DIO_OK;
}

static enum dio_status measure_memory(struct team *team, struct dio_peak *peak,
				      struct dio_error *error)
{
	uint64_t *memory = malloc(SWEEP_BYTES);
	enum dio_status status;

	if (!memory)
		return dio_fail(error, DIO_NO_MEM, "no memory for a sweep over %zu MiB",
				SWEEP_BYTES >> 20);
	/* Pages never written would all be the one page of zeros. */
	for (size_t i = 0; i < SWEEP_BYTES / sizeof *memory; i++)
		memory[i] = i;
	team->loop = NULL;
	team->memory = memory;
	team->words = SWEEP_BYTES / sizeof *memory / peak->threads;
	status = run_team(team, peak->threads, &peak->read_bytes_per_s, error);
	free(memory);
	return status;
}

enum dio_status dio_peak_measure(uint32_t threads, uint32_t cpu_mask, struct dio_peak *peak,
				 struct dio_error *error)
{
	uint32_t cpu = dvsm_cpu_detect() & (cpu_mask ? cpu_mask : (uint32_t)DVSM_CPU_ALL);
	struct team team = {.mutex = PTHREAD_MUTEX_INITIALIZER,
			    .decided = PTHREAD_COND_INITIALIZER};
	struct dio_peak made = {.threads = threads};
	enum dio_status status = measure_units(&team, cpu, &made, error);

	if (status == DIO_OK)
		status = measure_memory(&team, &made, error);
	if (status == DIO_OK)
		*peak = made;
	return status;
}

const struct dio_peak_unit *dio_peak_for(const struct dio_peak *peak, enum dvsm_precision precision)
{
	const struct dio_peak_unit *f32 = &peak->units[DIO_UNIT_F32];
	const struct dio_peak_unit *bf16 = &peak->units[DIO_UNIT_BF16];

	if (precision == DVSM_PRECISION_FIXED)
		return &peak->units[DIO_UNIT_INT8];
	if (precision == DVSM_PRECISION_BF16 && bf16->operations_per_s > f32->operations_per_s)
		return bf16;
	return f32;
}

const char *dio_unit_name(enum dio_unit unit)
{
	static const char *const NAMES[DIO_UNIT_COUNT] = {
		[DIO_UNIT_F32] = "f32",
		[DIO_UNIT_BF16] = "bf16",
		[DIO_UNIT_INT8] = "int8",
	};

	return NAMES[unit];
}
