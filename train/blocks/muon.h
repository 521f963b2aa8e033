/* One step of Muon (Jordan 2024) over the matrices of a network, on tiles (tiles.h). */
#pragma once

/* A weight and its state, `parts` matrices of [rows, cols] one below the other. */
struct dio_muon_weight {
	float *weight, *momentum;
	const float *gradient;
	int rows, cols, parts; /* rows and cols: multiples of 32 */
};

/**
 * momentum moves towards the gradient by 1 - inertia; the gradient moved towards it by inertia is
 * made orthogonal by five steps of the quintic Newton-Schulz iteration in bfloat16, scaled to the
 * size of AdamW's step, and taken.
 *
 * Returns 0, or -1 without memory or threads, and nothing was stepped.
 */
__attribute__((visibility("default"))) int dio_muon_step(const struct dio_muon_weight *weights,
							 int count, float rate, float decay,
							 float inertia, int threads);
