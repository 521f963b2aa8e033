/* Figures of the display loop: latency from camera to screen, pictures a second. */
#ifndef DIO_VIEWD_FIGURES_H
#define DIO_VIEWD_FIGURES_H

#include <stdint.h>

/** Pictures that the figures speak of: about ten seconds. */
#define DIO_FIGURES_WINDOW 300

/** Zero-initialise. */
struct dio_figures {
	uint64_t shown_ns[DIO_FIGURES_WINDOW];   /* rings: when each picture was shown, */
	uint64_t latency_ns[DIO_FIGURES_WINDOW]; /* and how old what it shows was */
	uint64_t shown, timed;                   /* pictures ever */
};

/** A picture reached the screen; `taken_ns` 0: it shows nothing that a camera saw. */
void dio_figures_note(struct dio_figures *figures, uint64_t taken_ns, uint64_t shown_ns);

/** Latency of the pictures in the window, in ms; 0 while none was timed. */
void dio_figures_get_latency(const struct dio_figures *figures, double *median_ms, double *p99_ms);

/** Pictures a second over the last second and a half. */
double dio_figures_get_rate(const struct dio_figures *figures, uint64_t now_ns);

/** Forget: another kind of picture comes. */
void dio_figures_clear(struct dio_figures *figures);

#endif
