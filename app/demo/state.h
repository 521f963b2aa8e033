/* What the stages of the demo hand to one another. */
#ifndef DIO_DEMO_STATE_H
#define DIO_DEMO_STATE_H

#include <cjson/cJSON.h>

#include "capture/calibrating.h"
#include "capture/posing.h"
#include "capture/recording_run.h"
#include "core/evaluate.h"
#include "demo/demo.h"

/** One stage that is over. */
struct dio_demo_stage {
	const char *name;
	double seconds;
	char result[160];
};

/** How far the estimates are from the simulated truth. */
struct dio_demo_truth {
	bool known;
	double fx_px, fy_px, cx_px, cy_px; /* estimate minus truth */
	double ray_mean_px, ray_max_px; /* where one ray lands in both cameras, over the picture */
	uint32_t poses;
	double position_mean_mm, position_max_mm;
	double rotation_mean_deg, rotation_max_deg;
};

#define DIO_DEMO_STAGES_MAX 8

struct dio_demo {
	const struct dio_demo_options *options;
	char walk[512];  /* the simulated camera's specification for the walk */
	char dance[512]; /* and for the calibration */
	struct dio_calibrating calibrating;
	struct dio_recording_result recording;
	struct dio_posing posing;
	struct dio_view_set set;
	struct dio_session *session;
	struct dio_evaluation evaluation;
	struct dio_picture *orbit; /* [orbit_count], a few pictures of the path for the sheet */
	uint32_t orbit_count;
	uint64_t orbit_render_ns; /* mean of a picture of the path */
	struct dio_demo_truth truth;
	struct dio_demo_stage stages[DIO_DEMO_STAGES_MAX];
	uint32_t stage_count;
};

/** options->out / name; release with free(). */
char *dio_demo_path(const struct dio_demo *demo, const char *name);

/** Render a path round the scene into orbit.mp4, keep some of its pictures for the sheet. */
enum dio_status dio_demo_render_orbit(struct dio_demo *demo, struct dio_error *error);

/** Draw sheet.png: inputs, rendered and true pictures, the orbit. */
enum dio_status dio_demo_write_sheet(const struct dio_demo *demo, struct dio_error *error);

/** Compare calibration and poses with the simulated camera. The only place that knows the truth. */
enum dio_status dio_demo_compare(struct dio_demo *demo, struct dio_error *error);

/** Write summary.md and summary.json; json: NULL, or receives the latter. */
enum dio_status dio_demo_write_summary(const struct dio_demo *demo, char **json,
				       struct dio_error *error);

#endif
