/* Cameras behind libcamera (0.0.3 of Debian 12 to 0.4 and later). The one driver in C++: a C
 * interface outside, and no exception leaves this file. */
#include "libcamera_session.h"

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

namespace dio_libcamera
{

dio_status fail_call(const libcamera_camera *camera, const char *what, int result, dio_error *error)
{
	const int cause = result < 0 ? -result : EIO;

	if (cause == EBUSY)
		return dio_fail(error, DIO_BUSY,
				"camera libcamera:%s: in use by another process; close that one "
				"first",
				camera->name);
	if (cause == ENODEV)
		return dio_fail(error, DIO_GONE, "camera libcamera:%s: unplugged; plug it in again",
				camera->name);
	return dio_fail(error, dio_status_from_errno(cause), "camera libcamera:%s: %s: %s",
			camera->name, what, strerror(cause));
}

bool offers(const session &own, const lc::ControlId &control)
{
	return own.camera->controls().count(&control) > 0;
}

} /* namespace dio_libcamera */

using namespace dio_libcamera;

static libcamera_camera *self(dio_camera *camera)
{
	return reinterpret_cast<libcamera_camera *>(camera);
}

/* Run a body; what it throws becomes a status. */
template <typename Body> static dio_status guarded(const char *name, dio_error *error, Body body)
{
	try {
		return body();
	} catch (const std::bad_alloc &) {
		return dio_fail(error, DIO_NO_MEM, "camera libcamera:%s: out of memory", name);
	} catch (const std::exception &fault) {
		return dio_fail(error, DIO_IO, "camera libcamera:%s: %s", name, fault.what());
	} catch (...) {
		return dio_fail(error, DIO_IO, "camera libcamera:%s: an unknown fault", name);
	}
}

extern "C" {

static dio_status libcamera_start(dio_camera *base, dio_error *error)
{
	return guarded(self(base)->name, error, [&] { return start(self(base), error); });
}

static dio_status libcamera_stop(dio_camera *base, dio_error *error)
{
	return guarded(self(base)->name, error, [&] {
		stop(self(base));
		return DIO_OK;
	});
}

static dio_status libcamera_acquire(dio_camera *base, dio_frame *frame, int64_t timeout_ns,
				    dio_error *error)
{
	libcamera_camera *camera = self(base);

	return guarded(camera->name, error, [&] {
		lc::Request *request = nullptr;
		dio_status status = give_back(camera, error);

		if (status == DIO_OK)
			status = take(camera, timeout_ns, &request, error);
		return status == DIO_OK ? lend(camera, request, frame, error) : status;
	});
}

static dio_status libcamera_control(dio_camera *base, const dio_camera_wish *wish,
				    dio_camera_controls *controls, dio_error *error)
{
	return guarded(self(base)->name, error,
		       [&] { return control(self(base), wish, controls, error); });
}

static void libcamera_close(dio_camera *base)
{
	libcamera_camera *camera = self(base);

	guarded(camera->name, nullptr, [&] {
		delete camera->own;
		return DIO_OK;
	});
	free(camera);
}

dio_status dio_libcamera_open(const char *id, const dio_camera_options *options,
			      dio_camera **camera, dio_error *error)
{
	static const dio_camera_ops ops = {libcamera_start, libcamera_stop,    libcamera_acquire,
					   libcamera_close, libcamera_control, nullptr};
	auto *made = static_cast<libcamera_camera *>(calloc(1, sizeof(libcamera_camera)));
	dio_status status;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "camera libcamera:%s: out of memory", id);
	snprintf(made->name, sizeof(made->name), "%s", id);
	made->base.ops = &ops;
	made->base.options = *options;
	made->base.frame_name = "";
	status = guarded(made->name, error, [&] {
		made->own = new session;
		return set_up(made, error);
	});
	if (status != DIO_OK) {
		libcamera_close(&made->base);
		return status;
	}
	*camera = &made->base;
	return DIO_OK;
}

} /* extern "C" */
