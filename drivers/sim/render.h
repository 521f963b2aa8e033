/* Light on the sensor, before the sensor does anything to it. */
#ifndef DIO_SIM_RENDER_H
#define DIO_SIM_RENDER_H

#include "scene.h"

/** rgb: [height][width][3] linear light, 1 is white. false when memory is short; rgb then holds
 * nothing of use. */
bool sim_render_linear(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
		       uint32_t samples, float *rgb);
/** The same bits from a processor with AVX2, sooner: rays side by side, see wide/. */
bool sim_render_linear_avx2(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
			    uint32_t samples, float *rgb);
/** And with AVX-512 (F). */
bool sim_render_linear_avx512(const struct dio_sim_scene *scene,
			      const struct dio_sim_camera *camera, uint32_t samples, float *rgb);

#endif
