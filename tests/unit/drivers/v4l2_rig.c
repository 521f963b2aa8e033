#include "v4l2_rig.h"

#include <string.h>

#include "check.h"

void rig_init(struct rig *rig)
{
	memset(rig, 0, sizeof(*rig));
	fake_v4l2_init(&rig->fake);
	rig->system = fake_v4l2_system(&rig->fake);
}

enum dio_status rig_open(struct rig *rig)
{
	enum dio_status status = dio_v4l2_open_on(&rig->system, "/dev/video9", &rig->options,
						  &rig->camera, &rig->error);

	if (status == DIO_OK)
		dio_camera_get_info(rig->camera, &rig->info);
	return status;
}

void rig_start(struct rig *rig)
{
	assert_ok(rig_open(rig), rig->error);
	assert_ok(dio_camera_start(rig->camera, &rig->error), rig->error);
}

enum dio_status rig_acquire(struct rig *rig, int64_t timeout_ns)
{
	enum dio_status status =
		dio_camera_acquire(rig->camera, &rig->frame, timeout_ns, &rig->error);

	dio_camera_get_counters(rig->camera, &rig->counters);
	return status;
}

void rig_close(struct rig *rig)
{
	dio_camera_close(rig->camera);
	rig->camera = NULL;
	assert_false(rig->fake.is_open);
	assert_false(rig->fake.is_streaming);
	assert_int_equal(rig->fake.mapped_count, 0);
	assert_int_equal(rig->fake.exported_count, 0);
}
