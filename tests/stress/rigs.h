/* Rigs that stand oddly: a changed arc, see stress_rig_fn. */
#ifndef TESTS_STRESS_RIGS_H
#define TESTS_STRESS_RIGS_H

#include "stress/world.h"

/** The rig and its target `amount` away from the world's origin; the target alone from the rig. */
stress_rig_fn stress_rig_far_away, stress_rig_far_target;

/** Everything `amount` times as large. */
stress_rig_fn stress_rig_scaled;

/** All context cameras at one place, `amount` apart; the same, `amount` away from the origin. */
stress_rig_fn stress_rig_one_place, stress_rig_one_far_place;

/** One context camera over and over. */
stress_rig_fn stress_rig_one_camera;

/** Pairs that look away from one another but for `amount` radians: no mean direction. */
stress_rig_fn stress_rig_back_to_back;

/** Pairs whose mean y axis lies along their mean z axis but for `amount` radians. */
stress_rig_fn stress_rig_crossed;

/** Rotations off by `amount`; the engine takes 1e-3. */
stress_rig_fn stress_rig_bent;

/** Focal lengths of `amount` picture widths; principal points `amount` widths off. */
stress_rig_fn stress_rig_long_lens, stress_rig_shifted_lens;

/** Pictures of one pixel, one row, one column. */
stress_rig_fn stress_rig_slivers;

#endif
