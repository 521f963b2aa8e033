/* Scenes of other programs, turned into ours (OpenCV axes, pixel centres at whole numbers). */
#ifndef DIO_APP_IMPORT_H
#define DIO_APP_IMPORT_H

#include "core/scene_file.h"

/**
 * nerfstudio / instant-ngp / Blender transforms.json: OpenGL axes (y up, z backward), intrinsics
 * per file or per frame, as fl_x or camera_angle_x, k1 k2 p1 p2 k3. The principal point there
 * counts from the picture's corner: pixel (0,0) has its centre at (0.5, 0.5), so 0.5 is taken off.
 *
 * scene   zero-initialised; files are given relative to `out_folder`
 *
 * DIO_UNSUPPORTED  a fisheye camera or a distortion term we do not have
 */
enum dio_status dio_import_transforms(const char *path, const char *out_folder,
				      struct dio_scene_file *scene, struct dio_error *error);

/**
 * COLMAP text model: cameras.txt and images.txt in `folder`; SIMPLE_PINHOLE, PINHOLE,
 * SIMPLE_RADIAL, RADIAL and OPENCV cameras. COLMAP too puts the centre of pixel (0,0) at (0.5,
 * 0.5).
 *
 * pictures   folder of the pictures, or NULL: `images` beside, one or two levels above
 */
enum dio_status dio_import_colmap(const char *folder, const char *pictures, const char *out_folder,
				  struct dio_scene_file *scene, struct dio_error *error);

#endif
