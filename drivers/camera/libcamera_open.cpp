/* Finding a camera of libcamera's, agreeing on a format, and its buffers. */
#include "libcamera_session.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>

#include "libcamera_values.h"

namespace dio_libcamera
{

/* libcamera allows one manager a process: all cameras share it, and the last one ends it, so that
 * a camera that is plugged in again is found by the next. One thread at a time opens and closes. */
static std::shared_ptr<lc::CameraManager> get_manager()
{
	static std::weak_ptr<lc::CameraManager> shared;
	auto manager = shared.lock();

	if (manager)
		return manager;
	manager = std::shared_ptr<lc::CameraManager>(new lc::CameraManager,
						     [](lc::CameraManager *ending) {
							     ending->stop();
							     delete ending;
						     });
	if (manager->start() != 0)
		return nullptr;
	shared = manager;
	return manager;
}

/* By number in the list, or by the identity that libcamera prints. */
static dio_status find_camera(libcamera_camera *camera, dio_error *error)
{
	session &own = *camera->own;
	char *end = nullptr;
	unsigned long number;

	own.manager = get_manager();
	if (!own.manager)
		return dio_fail(error, DIO_IO, "camera libcamera:%s: libcamera does not start",
				camera->name);
	const auto cameras = own.manager->cameras();
	number = strtoul(camera->name, &end, 10);
	if (camera->name[0] == '\0')
		number = 0;
	if (*end == '\0' && number < cameras.size())
		own.camera = cameras[number];
	else
		own.camera = own.manager->get(camera->name);
	if (!own.camera)
		return dio_fail(
			error, DIO_NOT_FOUND,
			"camera libcamera:%s: not among the %zu that libcamera finds; is it "
			"plugged in?",
			camera->name, cameras.size());
	return DIO_OK;
}

/* The best format on offer, and the size nearest to the wish: validate() adjusts. */
static dio_status configure(libcamera_camera *camera, dio_error *error)
{
	session &own = *camera->own;
	const dio_camera_options &wish = camera->base.options;
	dio_pixel_format format = DIO_PIXEL_RGB24;
	uint32_t rank, best = UINT32_MAX;
	int result;

	own.configuration = own.camera->generateConfiguration({lc::StreamRole::VideoRecording});
	if (!own.configuration || own.configuration->size() == 0)
		return dio_fail(error, DIO_UNSUPPORTED, "camera libcamera:%s: offers no video",
				camera->name);
	lc::StreamConfiguration &config = own.configuration->at(0);
	for (const lc::PixelFormat &offer : config.formats().pixelformats()) {
		if (dio_libcamera_format(offer.fourcc(), &format, &rank) && rank < best) {
			best = rank;
			config.pixelFormat = offer;
		}
	}
	if (wish.width > 0)
		config.size.width = wish.width;
	if (wish.height > 0)
		config.size.height = wish.height;
	if (config.bufferCount < 4)
		config.bufferCount = 4;
	if (own.configuration->validate() == lc::CameraConfiguration::Invalid ||
	    !dio_libcamera_format(config.pixelFormat.fourcc(), &format, &rank))
		return dio_fail(
			error, DIO_UNSUPPORTED,
			"camera libcamera:%s: offers %s; YUYV, NV12, BGR888, R8 or MJPEG is "
			"needed",
			camera->name, config.pixelFormat.toString().c_str());
	result = own.camera->configure(own.configuration.get());
	if (result != 0)
		return fail_call(camera, "cannot be configured", result, error);
	own.stream = config.stream();
	camera->base.info.format = format;
	camera->base.info.width = config.size.width;
	camera->base.info.height = config.size.height;
	const size_t bytes = dio_libcamera_frame_bytes(format, config.stride, config.size.width,
						       config.size.height);
	if (bytes == 0 || bytes > UINT32_MAX)
		return dio_fail(error, DIO_UNSUPPORTED,
				"camera libcamera:%s: %ux%u with %u bytes a row makes no sense",
				camera->name, config.size.width, config.size.height, config.stride);
	own.frame_bytes_min = static_cast<uint32_t>(bytes);
	return DIO_OK;
}

static size_t offset_of(const lc::FrameBuffer::Plane &plane)
{
	const bool given = plane.offset != lc::FrameBuffer::Plane::kInvalidOffset;

	return given ? plane.offset : 0;
}

/* Planes of one descriptor share a mapping, which spans them all. */
static dio_status map_buffer(libcamera_camera *camera, const lc::FrameBuffer *buffer,
			     dio_error *error)
{
	session &own = *camera->own;
	std::map<int, mapping> by_fd;
	planes where;

	for (const auto &plane : buffer->planes()) {
		mapping &map = by_fd[plane.fd.get()];

		map.size = std::max(map.size, offset_of(plane) + plane.length);
	}
	for (auto &entry : by_fd) {
		mapping &map = entry.second;

		own.mappings.reserve(own.mappings.size() + 1);
		map.memory = mmap(nullptr, map.size, PROT_READ, MAP_SHARED, entry.first, 0);
		if (map.memory == MAP_FAILED)
			return fail_call(camera, "a buffer cannot be mapped", -errno, error);
		own.mappings.push_back(map);
	}
	for (size_t i = 0; i < buffer->planes().size() && i < 2; i++) {
		const auto &plane = buffer->planes()[i];
		const auto *start = static_cast<const uint8_t *>(by_fd[plane.fd.get()].memory);

		(i == 0 ? where.first : where.second) = start + offset_of(plane);
		(i == 0 ? where.first_bytes : where.second_bytes) = plane.length;
	}
	if (where.first_bytes + where.second_bytes < own.frame_bytes_min)
		return dio_fail(error, DIO_UNSUPPORTED,
				"camera libcamera:%s: buffers of %zu bytes, a frame takes %u",
				camera->name, where.first_bytes + where.second_bytes,
				own.frame_bytes_min);
	own.buffers[buffer] = where;
	return DIO_OK;
}

static dio_status make_requests(libcamera_camera *camera, dio_error *error)
{
	session &own = *camera->own;
	int result;

	own.allocator = std::make_unique<lc::FrameBufferAllocator>(own.camera);
	result = own.allocator->allocate(own.stream);
	if (result < 0)
		return fail_call(camera, "no buffers", result, error);
	for (const auto &buffer : own.allocator->buffers(own.stream)) {
		auto request = own.camera->createRequest();
		dio_status status = map_buffer(camera, buffer.get(), error);

		if (status != DIO_OK)
			return status;
		if (!request || request->addBuffer(own.stream, buffer.get()) != 0)
			return dio_fail(error, DIO_NO_MEM, "camera libcamera:%s: no requests",
					camera->name);
		own.requests.push_back(std::move(request));
	}
	return DIO_OK;
}

dio_status set_up(libcamera_camera *camera, dio_error *error)
{
	session &own = *camera->own;
	dio_status status = find_camera(camera, error);
	int result;

	if (status != DIO_OK)
		return status;
	result = own.camera->acquire();
	if (result != 0)
		return fail_call(camera, "cannot be acquired", result, error);
	own.acquired = true;
	own.camera->requestCompleted.connect(&own, &session::on_completed);
	own.camera->disconnected.connect(&own, &session::on_disconnected);
	snprintf(camera->base.info.name, sizeof(camera->base.info.name), "libcamera:%s",
		 own.camera->id().c_str());
	own.pending = lc::ControlList(own.camera->controls());
	status = configure(camera, error);
	return status == DIO_OK ? make_requests(camera, error) : status;
}

} /* namespace dio_libcamera */
