/* MP4 (H.264 when libav offers an encoder, else MPEG-4) from RGB pictures. */
#ifndef DIO_VIDEO_H
#define DIO_VIDEO_H

#include "dio/frame.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

struct dio_video;

/** Write beside `path`; dio_video_close() renames it into place. Sizes are padded to even. */
enum dio_status dio_video_open(const char *path, uint32_t width, uint32_t height,
			       double frames_per_second, struct dio_video **video,
			       struct dio_error *error);
enum dio_status dio_video_append(struct dio_video *video, const struct dio_picture *picture,
				 struct dio_error *error);
/** Finish the file and release; NULL is fine. */
enum dio_status dio_video_close(struct dio_video *video, struct dio_error *error);
/** Give up: a former file of that name stays. NULL is fine. */
void dio_video_discard(struct dio_video *video);

#ifdef __cplusplus
}
#endif
#endif
