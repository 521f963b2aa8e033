#include "viewd/keyframe.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PI        3.14159265358979323846
#define DARK_MAX  5   /* 8-bit luma up to here is lost in the noise */
#define BRIGHT_AT 250 /* and from here on it is clipped */

/* Gaps between pictures beyond this say nothing about how fast the camera moves. */
#define GAP_MAX_NS 500000000u

const char *dio_keyframe_verdict_name(enum dio_keyframe_verdict verdict)
{
	static const char *const NAMES[DIO_KEYFRAME_VERDICTS] = {
		"kept",    "no board in view", "pose in doubt",    "too dark",     "too bright",
		"blurred", "moving too fast",  "no new viewpoint", "enough views",
	};

	return (unsigned)verdict < DIO_KEYFRAME_VERDICTS ? NAMES[verdict] : "unknown";
}

void dio_keyframe_defaults(double new_view_deg, uint32_t views_max,
			   struct dio_keyframe_options *options)
{
	*options = (struct dio_keyframe_options){
		.new_view_rad = new_view_deg * PI / 180,
		.new_view_share = 0.15,
		.clipped_max = 0.5,
		.sharpness_share = 0.5,
		.speed_max = 0.7,
		.views_max = views_max,
	};
}

static double luma(const uint8_t *rgb)
{
	return 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2];
}

void dio_keyframe_measure(const struct dio_picture *picture, struct dio_keyframe_quality *quality)
{
	double sum = 0, squares = 0, edges = 0, pixels = (double)picture->width * picture->height;
	size_t pitch = (size_t)picture->width * 3, dark = 0, bright = 0;

	for (uint32_t y = 0; y < picture->height; y++) {
		for (uint32_t x = 0; x < picture->width; x++) {
			const uint8_t *at = picture->rgb + y * pitch + 3u * x;
			double here = luma(at), edge;

			sum += here;
			squares += here * here;
			dark += here <= DARK_MAX;
			bright += here >= BRIGHT_AT;
			if (x == 0 || y == 0 || x + 1 == picture->width || y + 1 == picture->height)
				continue;
			edge = 4 * here - luma(at - 3) - luma(at + 3) - luma(at - pitch) -
			       luma(at + pitch);
			edges += edge * edge;
		}
	}
	*quality = (struct dio_keyframe_quality){.dark = (double)dark / pixels,
						 .bright = (double)bright / pixels};
	/* Over the variance, so that contrast and exposure do not count as sharpness. */
	squares -= sum * sum / pixels;
	if (squares > pixels)
		quality->sharpness = edges / squares;
}

/* The larger of the angle between two poses' directions to the centre, in units of the first
 * option, and how far they are apart for their distance, in units of the second: from 1 on the
 * one is a new viewpoint beside the other. */
static double difference(const struct dio_keyframe_options *options, const double a[16],
			 const double b[16], const double centre[3])
{
	double dot = 0, length_a = 0, length_b = 0, apart = 0, angle = 0, reach;

	for (int i = 0; i < 3; i++) {
		double da = a[4 * i + 3] - centre[i], db = b[4 * i + 3] - centre[i];

		dot += da * db;
		length_a += da * da;
		length_b += db * db;
		apart += (da - db) * (da - db);
	}
	reach = sqrt(fmin(length_a, length_b));
	if (reach > 0)
		angle = acos(fmax(-1, fmin(1, dot / sqrt(length_a * length_b))));
	return fmax(angle / fmax(options->new_view_rad, 1e-6),
		    sqrt(apart) / fmax(options->new_view_share * reach, 1e-9));
}

static bool is_known(const struct dio_keyframes *keyframes, const double pose[16],
		     const double centre[3])
{
	for (uint32_t i = 0; i < keyframes->count; i++)
		if (difference(&keyframes->options, keyframes->kept[i], pose, centre) < 1)
			return true;
	return false;
}

static double rotation_between(const double a[16], const double b[16])
{
	double trace = 0;

	for (int row = 0; row < 3; row++)
		for (int col = 0; col < 3; col++)
			trace += a[4 * row + col] * b[4 * row + col];
	return acos(fmax(-1, fmin(1, (trace - 1) / 2)));
}

/* Radians, or shares of the distance to the centre, a second; 0 when there is nothing to compare
 * with. */
static double speed(const struct dio_keyframes *keyframes, const double pose[16],
		    const double centre[3], uint64_t timestamp_ns)
{
	const double *last = keyframes->last_pose;
	double moved = 0, reach = 0, seconds;

	if (keyframes->last_ns == 0 || timestamp_ns <= keyframes->last_ns ||
	    timestamp_ns - keyframes->last_ns > GAP_MAX_NS)
		return 0;
	for (int i = 0; i < 3; i++) {
		moved += (pose[4 * i + 3] - last[4 * i + 3]) * (pose[4 * i + 3] - last[4 * i + 3]);
		reach += (pose[4 * i + 3] - centre[i]) * (pose[4 * i + 3] - centre[i]);
	}
	seconds = (double)(timestamp_ns - keyframes->last_ns) * 1e-9;
	return fmax(rotation_between(last, pose), sqrt(moved / fmax(reach, 1e-12))) / seconds;
}

/* The best of the pictures before, which saw much the same. */
static double best_recent(const struct dio_keyframes *keyframes)
{
	uint32_t count = keyframes->recent_count < DIO_KEYFRAME_MEMORY ? keyframes->recent_count
								       : DIO_KEYFRAME_MEMORY;
	double best = 0;

	for (uint32_t i = 0; i < count; i++)
		best = fmax(best, keyframes->recent[i]);
	return best;
}

static enum dio_keyframe_verdict judge(const struct dio_keyframes *keyframes,
				       const struct dio_keyframe_quality *quality,
				       const struct dio_pose *pose, const double centre[3],
				       uint64_t timestamp_ns)
{
	const struct dio_keyframe_options *options = &keyframes->options;

	if (!pose)
		return quality->board_seen ? DIO_KEYFRAME_NO_POSE : DIO_KEYFRAME_NO_BOARD;
	if (keyframes->count >= options->views_max)
		return DIO_KEYFRAME_FULL;
	if (quality->dark > options->clipped_max)
		return DIO_KEYFRAME_DARK;
	if (quality->bright > options->clipped_max)
		return DIO_KEYFRAME_BRIGHT;
	if (is_known(keyframes, pose->world_from_camera, centre))
		return DIO_KEYFRAME_KNOWN;
	if (speed(keyframes, pose->world_from_camera, centre, timestamp_ns) > options->speed_max)
		return DIO_KEYFRAME_MOVING;
	if (quality->sharpness < options->sharpness_share * best_recent(keyframes))
		return DIO_KEYFRAME_BLURRED;
	return DIO_KEYFRAME_KEPT;
}

enum dio_keyframe_verdict dio_keyframe_judge(struct dio_keyframes *keyframes,
					     const struct dio_keyframe_quality *quality,
					     const struct dio_pose *pose, const double centre[3],
					     uint64_t timestamp_ns)
{
	enum dio_keyframe_verdict verdict = judge(keyframes, quality, pose, centre, timestamp_ns);

	keyframes->verdicts[verdict]++;
	keyframes->last_ns = pose ? timestamp_ns : 0;
	if (!pose)
		return verdict;
	memcpy(keyframes->last_pose, pose->world_from_camera, sizeof keyframes->last_pose);
	keyframes->recent[keyframes->recent_count % DIO_KEYFRAME_MEMORY] = quality->sharpness;
	keyframes->recent_count++;
	return verdict;
}

bool dio_keyframe_keep(struct dio_keyframes *keyframes, const struct dio_pose *pose)
{
	if (keyframes->count == keyframes->capacity) {
		uint32_t capacity = keyframes->capacity ? keyframes->capacity * 2 : 32;
		double(*grown)[16] = reallocarray(keyframes->kept, capacity, sizeof *grown);

		if (!grown)
			return false;
		keyframes->kept = grown;
		keyframes->capacity = capacity;
	}
	memcpy(keyframes->kept[keyframes->count++], pose->world_from_camera,
	       sizeof *keyframes->kept);
	return true;
}

void dio_keyframe_clear(struct dio_keyframes *keyframes)
{
	struct dio_keyframe_options options = keyframes->options;

	dio_keyframe_deinit(keyframes);
	keyframes->options = options;
}

void dio_keyframe_deinit(struct dio_keyframes *keyframes)
{
	free(keyframes->kept);
	*keyframes = (struct dio_keyframes){0};
}
