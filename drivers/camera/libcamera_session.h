/* A libcamera camera that is open, as the files of its driver share it. C++; camera.c sees
 * backend.h alone. Functions throw what libcamera and the standard library throw: libcamera.cpp
 * makes statuses of it. */
#ifndef DIO_CAMERA_LIBCAMERA_SESSION_H
#define DIO_CAMERA_LIBCAMERA_SESSION_H

#include "backend.h"

#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include <sys/mman.h>

#include <libcamera/libcamera.h>

namespace lc = libcamera;

namespace dio_libcamera
{

/* One mapped stretch of a descriptor. */
struct mapping {
	void *memory = MAP_FAILED;
	size_t size = 0;
};

/* Where a buffer's planes begin; they point into the mappings. */
struct planes {
	const uint8_t *first = nullptr;
	const uint8_t *second = nullptr; /* NV12 */
	size_t first_bytes = 0, second_bytes = 0;
};

struct session {
	std::shared_ptr<lc::CameraManager> manager;
	std::shared_ptr<lc::Camera> camera;
	std::unique_ptr<lc::CameraConfiguration> configuration;
	std::unique_ptr<lc::FrameBufferAllocator> allocator;
	std::vector<std::unique_ptr<lc::Request>> requests;
	std::vector<mapping> mappings;
	std::map<const lc::FrameBuffer *, planes> buffers;
	lc::Stream *stream = nullptr;
	bool acquired = false;

	/* Written by libcamera's thread. */
	std::mutex lock;
	std::condition_variable completed_one;
	std::deque<lc::Request *> completed;
	bool gone = false;

	lc::Request *held = nullptr; /* lent to the caller */
	lc::ControlList pending;     /* goes with the next request */
	uint32_t frame_bytes_min = 1;
	bool sequenced = false;
	uint32_t last_sequence = 0;
	std::vector<uint8_t> joined; /* NV12 whose planes lie apart */
	bool holding = false;
	dio_frame_metadata metadata = {};
	bool said_exposure = false, said_gain = false, said_colours = false;

	void on_completed(lc::Request *request)
	{
		std::lock_guard<std::mutex> guard(lock);

		if (request->status() == lc::Request::RequestCancelled)
			return;
		completed.push_back(request);
		completed_one.notify_one();
	}

	void on_disconnected()
	{
		std::lock_guard<std::mutex> guard(lock);

		gone = true;
		completed_one.notify_one();
	}

	~session()
	{
		if (camera) {
			camera->requestCompleted.disconnect(this);
			camera->disconnected.disconnect(this);
		}
		requests.clear();
		for (const mapping &map : mappings)
			munmap(map.memory, map.size);
		if (allocator && stream)
			allocator->free(stream);
		allocator.reset();
		if (acquired)
			camera->release();
		configuration.reset();
		camera.reset();
	}
};

/* The C object; first member as for every backend. */
struct libcamera_camera {
	dio_camera base;
	session *own;
	char name[160]; /* as the user gave it, for messages */
};

/** The status and the line for a libcamera call that returned `result`, below 0 an errno. */
dio_status fail_call(const libcamera_camera *camera, const char *what, int result,
		     dio_error *error);

bool offers(const session &own, const lc::ControlId &control);

/* ---- libcamera_open.cpp ---- */

/** Find and acquire the camera, agree on a format, map its buffers and make their requests. */
dio_status set_up(libcamera_camera *camera, dio_error *error);

/* ---- libcamera_requests.cpp ---- */

dio_status start(libcamera_camera *camera, dio_error *error);

/** All requests come back before it returns. */
void stop(libcamera_camera *camera);

/** Hand a request to the camera, with the controls that wait. */
dio_status queue(libcamera_camera *camera, lc::Request *request, dio_error *error);

/** The next good request, the newest one unless every frame is wished. DIO_AGAIN: none in time. */
dio_status take(libcamera_camera *camera, int64_t timeout_ns, lc::Request **taken,
		dio_error *error);

/** Lend a taken request's frame to the caller, until give_back(). */
dio_status lend(libcamera_camera *camera, lc::Request *request, dio_frame *frame, dio_error *error);
dio_status give_back(libcamera_camera *camera, dio_error *error);

/* ---- libcamera_controls.cpp ---- */

/** `wish` NULL: only read. */
dio_status control(libcamera_camera *camera, const dio_camera_wish *wish,
		   dio_camera_controls *controls, dio_error *error);

} /* namespace dio_libcamera */

#endif
