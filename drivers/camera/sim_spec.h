/* The words of a simulated camera: "table?seed=7&width=640&...". */
#ifndef DIO_CAMERA_SIM_SPEC_H
#define DIO_CAMERA_SIM_SPEC_H

#include <stdint.h>

#include "dio/sim.h"
#include "dio/status.h"

struct dio_sim_spec {
	struct dio_sim_scene_options scene;
	uint32_t width, height;
	uint32_t style;   /* of dio_sim_viewpoint() */
	uint32_t samples; /* rays a pixel side */
	double fps;
	uint64_t frames;   /* 0: endless */
	double fov_deg;    /* horizontal */
	double distortion; /* 0: none, 1: a wide-angle lens's barrel, below 0: a cushion */
	struct dio_sim_sensor sensor;
};

/**
 * Read the words: a scene (table, room, turntable, street), then ? and key=value pairs joined by &.
 *
 *   seed        64-bit number; scene, lens and noise follow from it           (1)
 *   width, height   16..4096 pixels                                      (640, 480)
 *   fps         0.01..1000                                                      (30)
 *   frames      0: endless                                                       (0)
 *   style       walk (round the scene) or dance (for calibration)             (walk)
 *   board       none, or charuco:COLSxROWS:SQUARE_M:MARKER_M:DICT_6X6_250[:legacy]
 *               (table: charuco:10x7:0.0285:0.0171:DICT_6X6_250; others: none)
 *   clear       1 keeps things off the board                                     (1)
 *   fov         20..120 degrees, horizontal                                     (60)
 *   distortion  -1..1                                                         (0.25)
 *   noise       standard deviation of read noise, 0..0.5                     (0.004)
 *   exposure    stops, -4..4                                                     (0)
 *   blur        standard deviation, 0..8 pixels                                (0.5)
 *   vignetting  0..1                                                           (0.1)
 *   samples     1..8 rays a pixel side                                           (2)
 *
 * DIO_BAD_ARG  the text names the word and what may stand there
 */
enum dio_status dio_sim_spec_parse(const char *words, struct dio_sim_spec *spec,
				   struct dio_error *error);

#endif
