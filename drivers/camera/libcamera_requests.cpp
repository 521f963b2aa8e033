/* Requests of a libcamera camera on their way: queued, completed, lent as frames. */
#include "libcamera_session.h"

#include <chrono>
#include <cstring>
#include <ctime>

#include "dio/clock.h"
#include "libcamera_values.h"

namespace c = libcamera::controls;

namespace dio_libcamera
{

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

	own.camera->stop();
	std::lock_guard<std::mutex> guard(own.lock);
	own.completed.clear();
	own.held = nullptr;
}

static void count_gap(libcamera_camera *camera, uint32_t sequence)
{
	session &own = *camera->own;
	const uint32_t step = sequence - own.last_sequence;

	if (own.sequenced && step > 1 && step < UINT32_MAX / 2)
		camera->base.counters.lost += step - 1;
	own.sequenced = true;
	own.last_sequence = sequence;
}

/* What the camera says of a frame goes into our metadata; what it leaves out stays as it was. */
static void read_metadata(session &own, lc::Request *request)
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
static lc::Request *wait_completed(session &own, int64_t timeout_ns)
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
static bool is_broken(session &own, dio_pixel_format format, const lc::FrameBuffer *buffer)
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

static dio_status fail_gone(const libcamera_camera *camera, dio_error *error)
{
	return dio_fail(error, DIO_GONE,
			"camera libcamera:%s: unplugged after %llu frames; plug it in again",
			camera->name,
			static_cast<unsigned long long>(camera->base.counters.delivered));
}

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

static uint64_t sleep_ns()
{
	timespec boot, monotonic;

	clock_gettime(CLOCK_BOOTTIME, &boot);
	clock_gettime(CLOCK_MONOTONIC, &monotonic);
	return static_cast<uint64_t>(boot.tv_sec - monotonic.tv_sec) * 1000000000u;
}

/* Where the frame's bytes are in one piece: a copy only for NV12 whose planes lie apart. */
static const uint8_t *in_one_piece(libcamera_camera *camera, const planes &where, uint32_t pitch)
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

} /* namespace dio_libcamera */
