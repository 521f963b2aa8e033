/* Cameras behind libcamera (0.0.3 of Debian 12 to 0.4 and later). The one C++ file of the drivers:
 * a C interface outside, and no exception leaves it. */
#include "backend.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <string>
#include <vector>

#include <sys/mman.h>

#include <libcamera/libcamera.h>
#include <libcamera/version.h>

#include "dio/clock.h"
#include "libcamera_values.h"

namespace lc = libcamera;
namespace c = libcamera::controls;

namespace
{

/* Flicker controls came with 0.1. */
#define HAS_FLICKER (LIBCAMERA_VERSION_MAJOR > 0 || LIBCAMERA_VERSION_MINOR >= 1)

/* Frames that a wish may take until it shows in their metadata, and the longest wait for one. */
constexpr int CONFIRM_FRAMES = 15;
constexpr int64_t CONFIRM_WAIT_NS = 500000000;
constexpr uint32_t ALL_3A = DIO_LOCK_EXPOSURE | DIO_LOCK_GAIN | DIO_LOCK_WHITE_BALANCE;

/* libcamera allows one manager a process: all cameras share it, and the last one ends it, so that
 * a camera that is plugged in again is found by the next. One thread at a time opens and closes. */
std::shared_ptr<lc::CameraManager> get_manager()
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

libcamera_camera *self(dio_camera *camera)
{
	return reinterpret_cast<libcamera_camera *>(camera);
}

/* Run a body; what it throws becomes a status. */
template <typename Body> dio_status guarded(const char *name, dio_error *error, Body body)
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

dio_status fail_gone(const libcamera_camera *camera, dio_error *error)
{
	return dio_fail(error, DIO_GONE,
			"camera libcamera:%s: unplugged after %llu frames; plug it in again",
			camera->name,
			static_cast<unsigned long long>(camera->base.counters.delivered));
}

bool offers(const session &own, const lc::ControlId &control)
{
	return own.camera->controls().count(&control) > 0;
}

/* By number in the list, or by the identity that libcamera prints. */
dio_status find_camera(libcamera_camera *camera, dio_error *error)
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
dio_status configure(libcamera_camera *camera, dio_error *error)
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

size_t offset_of(const lc::FrameBuffer::Plane &plane)
{
	const bool given = plane.offset != lc::FrameBuffer::Plane::kInvalidOffset;

	return given ? plane.offset : 0;
}

/* Planes of one descriptor share a mapping, which spans them all. */
dio_status map_buffer(libcamera_camera *camera, const lc::FrameBuffer *buffer, dio_error *error)
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

dio_status make_requests(libcamera_camera *camera, dio_error *error)
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

/* Hand a request to the camera, with the controls that wait. */
dio_status queue(libcamera_camera *camera, lc::Request *request, dio_error *error)
{
	session &own = *camera->own;
	int result;

	request->reuse(lc::Request::ReuseBuffers);
	request->controls().merge(own.pending);
	own.pending.clear();
	result = own.camera->queueRequest(request);
	return result == 0 ? DIO_OK : fail_call(camera, "a request is refused", result, error);
}

dio_status start(libcamera_camera *camera, dio_error *error)
{
	session &own = *camera->own;
	const double rate = camera->base.options.frames_per_second;
	lc::ControlList controls(own.camera->controls());
	dio_status status = DIO_OK;
	int result;

	if (rate > 0 && offers(own, c::FrameDurationLimits)) {
		const int64_t duration_us = static_cast<int64_t>(1e6 / rate);

		controls.set(c::FrameDurationLimits, {duration_us, duration_us});
		camera->base.info.frames_per_second = rate;
	}
	own.sequenced = false;
	result = own.camera->start(&controls);
	if (result != 0)
		return fail_call(camera, "does not start", result, error);
	for (const auto &request : own.requests) {
		status = queue(camera, request.get(), error);
		if (status != DIO_OK)
			break;
	}
	if (status != DIO_OK)
		own.camera->stop();
	return status;
}

void stop(libcamera_camera *camera)
{
	session &own = *camera->own;

	/* All requests come back before it returns. */
	own.camera->stop();
	std::lock_guard<std::mutex> guard(own.lock);
	own.completed.clear();
	own.held = nullptr;
}

void count_gap(libcamera_camera *camera, uint32_t sequence)
{
	session &own = *camera->own;
	const uint32_t step = sequence - own.last_sequence;

	if (own.sequenced && step > 1 && step < UINT32_MAX / 2)
		camera->base.counters.lost += step - 1;
	own.sequenced = true;
	own.last_sequence = sequence;
}

/* What the camera says of a frame goes into our metadata; what it leaves out stays as it was. */
void read_metadata(session &own, lc::Request *request)
{
	const lc::ControlList &said = request->metadata();
	const auto exposure = said.get(c::ExposureTime);
	const auto gain = said.get(c::AnalogueGain);
	const auto colours = said.get(c::ColourGains);
	const auto temperature = said.get(c::ColourTemperature);

	if (exposure && *exposure > 0)
		own.metadata.exposure_us = static_cast<uint32_t>(*exposure);
	if (gain && *gain > 0)
		own.metadata.gain = *gain;
	if (colours) {
		own.metadata.red_gain = (*colours)[0];
		own.metadata.blue_gain = (*colours)[1];
	}
	if (temperature && *temperature > 0)
		own.metadata.white_balance_k = static_cast<uint32_t>(*temperature);
	own.said_exposure = exposure.has_value();
	own.said_gain = gain.has_value();
	own.said_colours = colours.has_value();
}

/* Wait for a completed request. nullptr: none in time, or the camera is gone. */
lc::Request *wait_completed(session &own, int64_t timeout_ns)
{
	std::unique_lock<std::mutex> guard(own.lock);
	lc::Request *request;

	own.completed_one.wait_for(guard, std::chrono::nanoseconds(timeout_ns),
				   [&own] { return own.gone || !own.completed.empty(); });
	if (own.gone || own.completed.empty())
		return nullptr;
	request = own.completed.front();
	own.completed.pop_front();
	return request;
}

/* Some pipelines leave out how many bytes they wrote; a picture that is not compressed has them all
 * or is flagged. */
bool is_broken(session &own, dio_pixel_format format, const lc::FrameBuffer *buffer)
{
	const auto &metadata = buffer->metadata();
	size_t bytes = 0;

	for (const auto &plane : metadata.planes())
		bytes += plane.bytesused;
	if (metadata.status != lc::FrameMetadata::FrameSuccess)
		return true;
	if (format == DIO_PIXEL_MJPEG)
		return bytes == 0 || bytes > own.buffers[buffer].first_bytes;
	return bytes > 0 && bytes < own.frame_bytes_min;
}

/* The next good request, the newest one unless every frame is wished. */
dio_status take(libcamera_camera *camera, int64_t timeout_ns, lc::Request **taken, dio_error *error)
{
	session &own = *camera->own;
	const uint64_t deadline_ns = dio_clock_ns() + static_cast<uint64_t>(timeout_ns);
	lc::Request *newest = nullptr;
	dio_status status = DIO_OK;

	for (;;) {
		const uint64_t now = dio_clock_ns();
		const int64_t left =
			newest || now >= deadline_ns ? 0 : static_cast<int64_t>(deadline_ns - now);
		lc::Request *request = wait_completed(own, left);

		if (!request)
			break;
		const lc::FrameBuffer *buffer = request->findBuffer(own.stream);
		count_gap(camera, buffer->metadata().sequence);
		read_metadata(own, request);
		if (is_broken(own, camera->base.info.format, buffer)) {
			camera->base.counters.broken++;
			status = queue(camera, request, error);
		} else {
			if (newest) {
				camera->base.counters.drained++;
				status = queue(camera, newest, error);
			}
			newest = request;
		}
		if (status != DIO_OK)
			return status;
		if (newest && camera->base.options.every_frame)
			break;
	}
	if (newest) {
		*taken = newest;
		return DIO_OK;
	}
	{
		std::lock_guard<std::mutex> guard(own.lock);

		if (own.gone)
			return fail_gone(camera, error);
	}
	return dio_fail(error, DIO_AGAIN, "camera libcamera:%s: no frame for %lld ms", camera->name,
			static_cast<long long>(timeout_ns / 1000000));
}

uint64_t sleep_ns()
{
	timespec boot, monotonic;

	clock_gettime(CLOCK_BOOTTIME, &boot);
	clock_gettime(CLOCK_MONOTONIC, &monotonic);
	return static_cast<uint64_t>(boot.tv_sec - monotonic.tv_sec) * 1000000000u;
}

/* Where the frame's bytes are in one piece: a copy only for NV12 whose planes lie apart. */
const uint8_t *in_one_piece(libcamera_camera *camera, const planes &where, uint32_t pitch)
{
	session &own = *camera->own;
	const size_t luma = static_cast<size_t>(pitch) * camera->base.info.height;

	if (camera->base.info.format != DIO_PIXEL_NV12 || !where.second ||
	    where.second == where.first + luma)
		return where.first; /* both planes lie in one mapping */
	const size_t chroma = own.frame_bytes_min - luma;
	if (where.first_bytes < luma || where.second_bytes < chroma)
		return nullptr;
	own.joined.resize(own.frame_bytes_min);
	memcpy(own.joined.data(), where.first, luma);
	memcpy(own.joined.data() + luma, where.second, chroma);
	return own.joined.data();
}

dio_status lend(libcamera_camera *camera, lc::Request *request, dio_frame *frame, dio_error *error)
{
	session &own = *camera->own;
	const lc::FrameBuffer *buffer = request->findBuffer(own.stream);
	const auto &metadata = buffer->metadata();
	const lc::StreamConfiguration &config = own.configuration->at(0);
	const auto sensor = request->metadata().get(c::SensorTimestamp);
	dio_frame lent = {};

	own.held = request;
	lent.format = camera->base.info.format;
	lent.width = camera->base.info.width;
	lent.height = camera->base.info.height;
	lent.pitch_bytes = lent.format == DIO_PIXEL_MJPEG ? 0 : config.stride;
	lent.sequence = metadata.sequence;
	lent.timestamp_ns =
		dio_libcamera_time(sensor && *sensor > 0 ? static_cast<uint64_t>(*sensor) : 0,
				   metadata.timestamp, dio_clock_ns(), sleep_ns());
	lent.data = in_one_piece(camera, own.buffers[buffer], config.stride);
	lent.size_bytes = lent.format == DIO_PIXEL_MJPEG ? metadata.planes()[0].bytesused
							 : own.frame_bytes_min;
	lent.metadata = own.metadata;
	if (!lent.data)
		return dio_fail(error, DIO_IO, "camera libcamera:%s: a buffer is too small",
				camera->name);
	*frame = lent;
	return DIO_OK;
}

dio_status give_back(libcamera_camera *camera, dio_error *error)
{
	lc::Request *held = camera->own->held;

	camera->own->held = nullptr;
	return held ? queue(camera, held, error) : DIO_OK;
}

uint32_t list_offered(const session &own)
{
	uint32_t offered = 0;

	if (offers(own, c::AeEnable) && offers(own, c::ExposureTime))
		offered |= DIO_LOCK_EXPOSURE;
	if (offers(own, c::AeEnable) && offers(own, c::AnalogueGain))
		offered |= DIO_LOCK_GAIN;
	if (offers(own, c::AwbEnable))
		offered |= DIO_LOCK_WHITE_BALANCE;
	return offered;
}

/* Exposure and gain have one automatic: a wish about either makes both manual. */
void wish_exposure(session &own, const dio_camera_wish &wish, uint32_t offered,
		   dio_frame_metadata *target)
{
	const bool manual = wish.hold || wish.exposure_us > 0 || wish.gain > 0;

	if (!offers(own, c::AeEnable))
		return;
	own.pending.set(c::AeEnable, !manual);
	if (!manual)
		return;
	target->exposure_us = wish.exposure_us > 0 ? wish.exposure_us : own.metadata.exposure_us;
	target->gain = wish.gain > 0 ? static_cast<float>(wish.gain) : own.metadata.gain;
	if ((offered & DIO_LOCK_EXPOSURE) && target->exposure_us > 0 &&
	    target->exposure_us <= INT32_MAX)
		own.pending.set(c::ExposureTime, static_cast<int32_t>(target->exposure_us));
	if ((offered & DIO_LOCK_GAIN) && target->gain > 0)
		own.pending.set(c::AnalogueGain, target->gain);
}

void wish_colours(session &own, const dio_camera_wish &wish, dio_frame_metadata *target)
{

	if (!offers(own, c::AwbEnable))
		return;
	own.pending.set(c::AwbEnable, !wish.hold);
	target->red_gain = own.metadata.red_gain;
	target->blue_gain = own.metadata.blue_gain;
	if (wish.hold && offers(own, c::ColourGains) && target->red_gain > 0 &&
	    target->blue_gain > 0)
		own.pending.set(c::ColourGains, {target->red_gain, target->blue_gain});
}

dio_camera_flicker wish_flicker(session &own, dio_camera_flicker flicker)
{
#if HAS_FLICKER
	const int32_t period_us = dio_libcamera_flicker_period_us(flicker);

	if (flicker == DIO_CAMERA_FLICKER_KEEP || !offers(own, c::AeFlickerMode))
		return DIO_CAMERA_FLICKER_KEEP;
	if (period_us > 0 && offers(own, c::AeFlickerPeriod)) {
		own.pending.set(c::AeFlickerMode, static_cast<int32_t>(c::FlickerManual));
		own.pending.set(c::AeFlickerPeriod, period_us);
		return flicker;
	}
	own.pending.set(c::AeFlickerMode,
			static_cast<int32_t>(flicker == DIO_CAMERA_FLICKER_AUTO ? c::FlickerAuto
										: c::FlickerOff));
	return flicker == DIO_CAMERA_FLICKER_AUTO ? flicker : DIO_CAMERA_FLICKER_OFF;
#else
	(void)own;
	(void)flicker;
	return DIO_CAMERA_FLICKER_KEEP;
#endif
}

/* What the last frame's metadata confirms of the target. */
uint32_t confirmed(const session &own, const dio_frame_metadata &target, uint32_t offered)
{
	uint32_t held = 0;

	if (own.said_exposure && target.exposure_us > 0 &&
	    dio_libcamera_is_near(target.exposure_us, own.metadata.exposure_us))
		held |= DIO_LOCK_EXPOSURE;
	if (own.said_gain && target.gain > 0 &&
	    dio_libcamera_is_near(target.gain, own.metadata.gain))
		held |= DIO_LOCK_GAIN;
	if (own.said_colours && target.red_gain > 0 &&
	    dio_libcamera_is_near(target.red_gain, own.metadata.red_gain) &&
	    dio_libcamera_is_near(target.blue_gain, own.metadata.blue_gain))
		held |= DIO_LOCK_WHITE_BALANCE;
	return held & offered;
}

/* Controls take effect some frames later: go on until the metadata show it. */
dio_status confirm(libcamera_camera *camera, const dio_frame_metadata &target, uint32_t wanted,
		   dio_error *error)
{
	session &own = *camera->own;
	dio_status status = give_back(camera, error);

	for (int i = 0; i < CONFIRM_FRAMES && status == DIO_OK; i++) {
		lc::Request *request;

		status = take(camera, CONFIRM_WAIT_NS, &request, error);
		if (status != DIO_OK)
			break;
		camera->base.counters.drained++;
		own.metadata.locked = confirmed(own, target, wanted);
		status = queue(camera, request, error);
		/* Two frames at least: the first may have been exposed before. */
		if (own.metadata.locked == wanted && i >= 1)
			break;
	}
	return status == DIO_AGAIN ? DIO_OK : status;
}

dio_status control(libcamera_camera *camera, const dio_camera_wish *wish,
		   dio_camera_controls *controls, dio_error *error)
{
	session &own = *camera->own;
	const uint32_t offered = list_offered(own) & ALL_3A;
	dio_frame_metadata target = {};
	dio_status status = DIO_OK;

	controls->offered = offered;
	if (wish) {
		controls->flicker = wish_flicker(own, wish->flicker);
		wish_exposure(own, *wish, offered, &target);
		wish_colours(own, *wish, &target);
		own.holding = wish->hold;
		own.metadata.locked = 0;
		if (camera->base.started && wish->hold && offered)
			status = confirm(camera, target, offered, error);
	}
	controls->metadata = own.metadata;
	return status;
}

} /* namespace */

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
