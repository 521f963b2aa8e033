/* The wall between C++ and C: failures travel as exceptions inside, as dio_status outside. */
#ifndef DIO_CALIB_GUARD_HPP
#define DIO_CALIB_GUARD_HPP

#include <cstdarg>
#include <cstdio>
#include <exception>
#include <new>

#include <opencv2/core.hpp>

#include "dio/status.h"

namespace dio
{

/* What fail() throws: a status and the line for the user. */
struct Failure : std::exception {
	dio_status status = DIO_BAD_ARG;
	dio_error error = {};
	const char *what() const noexcept override
	{
		return error.text;
	}
};

/** Leave with a status and one line that names the thing, the fault and the remedy. */
[[noreturn]] __attribute__((format(printf, 2, 3))) inline void fail(dio_status status,
								    const char *format, ...)
{
	Failure failure;
	failure.status = status;
	va_list args;
	va_start(args, format);
	vsnprintf(failure.error.text, sizeof(failure.error.text), format, args);
	va_end(args);
	throw failure;
}

/** Run `body`; whatever it throws becomes a status and a line. `what` names the operation. */
template <typename Body>
dio_status guarded(dio_error *error, const char *what, Body &&body) noexcept
{
	try {
		body();
		return DIO_OK;
	} catch (const Failure &failure) {
		return dio_fail(error, failure.status, "%s", failure.error.text);
	} catch (const std::bad_alloc &) {
		return dio_fail(error, DIO_NO_MEM, "%s: out of memory", what);
	} catch (const cv::Exception &exception) {
		dio_status status =
			exception.code == cv::Error::StsNoMem ? DIO_NO_MEM : DIO_BAD_ARG;
		return dio_fail(error, status, "%s: OpenCV refuses the data: %s (%s)", what,
				exception.err.c_str(), exception.func.c_str());
	} catch (const std::exception &exception) {
		return dio_fail(error, DIO_BAD_ARG, "%s: %s", what, exception.what());
	} catch (...) {
		return dio_fail(error, DIO_BAD_ARG, "%s: unknown failure inside a library", what);
	}
}

} // namespace dio

#endif
