/* How fine to render so that the frame time is kept: a ladder of patch sizes. */
#ifndef DIO_VIEWD_PACE_H
#define DIO_VIEWD_PACE_H

#include <stdint.h>

#define DIO_PACE_RUNGS   4
#define DIO_PACE_SAMPLES 9

/** Rung 0 is the finest. */
struct dio_pace {
	uint32_t patch_px[DIO_PACE_RUNGS], tokens[DIO_PACE_RUNGS];
	uint32_t rungs, rung;
	uint64_t budget_ns;
	uint64_t samples_ns[DIO_PACE_SAMPLES]; /* render times on this rung, a ring */
	uint32_t count;
};

/**
 * A ladder for pictures of width x height.
 *
 * patch_px    the finest patch
 * budget_ns   time that a picture may take
 */
void dio_pace_init(struct dio_pace *pace, uint32_t width, uint32_t height, uint32_t patch_px,
		   uint64_t budget_ns);

/** The patch to render with now. */
uint32_t dio_pace_get_patch(const struct dio_pace *pace);

/**
 * Note what a picture took. Nine pictures on a rung decide by their median: too slow, the next
 * coarser one; fast enough that the finer one would keep the time with a fifth to spare, that one.
 */
void dio_pace_note(struct dio_pace *pace, uint64_t render_ns);

#endif
