/* A golden case (MODEL.md section 9): posed pictures, targets, and what the oracle expects. */
#ifndef TESTS_SUPPORT_GOLDEN_CASE_H
#define TESTS_SUPPORT_GOLDEN_CASE_H

#include "dvsm/dvsm.h"
#include "support/npz.h"

struct support_case {
	char name[64];
	char model_path[1024];
	struct dvsm_view *views; /* [view_count] context views, pictures owned */
	uint32_t view_count;
	struct dvsm_camera *targets; /* [target_count] */
	uint32_t target_count;
	uint32_t recon_patch_px, render_patch_px;
	struct support_array render;         /* [targets][height][width][3] */
	struct support_array k0, v0, kl, vl; /* [heads][tokens][D/heads] */
};

/** Read a case's folder; NULL with a printed line. Release with support_case_free(). */
struct support_case *support_case_read(const char *folder);

void support_case_free(struct support_case *item);

/** Names of the folders in DIO_SHARED_DIR/golden, sorted; count, 0 when there are none. */
#define SUPPORT_MAX_CASES 64
size_t support_case_list(char folders[SUPPORT_MAX_CASES][1024]);

#endif
