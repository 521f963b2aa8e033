/* From light to a picture. */
#ifndef DIO_SIM_SENSOR_H
#define DIO_SIM_SENSOR_H

#include "scene.h"

/** Blur, vignetting, exposure (on top of `gain`), white balance, highlight shoulder, sRGB curve, in
 * place: linear light becomes encoded values in [0, 1]. false when memory is short. */
bool sim_sensor_expose(const struct dio_sim_sensor *sensor, const struct dio_sim_camera *camera,
		       float gain, float *rgb);

/** Read and shot noise on encoded values, by a hash of the value's place and the seed. */
void sim_sensor_add_noise(const struct dio_sim_sensor *sensor, size_t values, float *rgb);

/** What a JPEG file of the picture would keep of it; nothing happens without jpeg_quality. */
void sim_sensor_compress(const struct dio_sim_sensor *sensor, const struct dio_sim_camera *camera,
			 float *rgb);

void sim_sensor_quantise(const float *rgb, size_t values, uint8_t *bytes);

#endif
