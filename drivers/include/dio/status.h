/* Status codes and error texts shared by drivers/, calib/ and app/. */
#ifndef DIO_STATUS_H
#define DIO_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

/** Every function that can fail returns one; outputs stay untouched unless it says otherwise. */
enum dio_status {
	DIO_OK = 0,
	/* States, not failures. */
	DIO_AGAIN,     /* nothing yet: the timeout passed without a frame */
	DIO_END,       /* a folder or recording is at its end */
	DIO_NO_SIGNAL, /* the device is there and delivers nothing */
	/* Failures. */
	DIO_BAD_ARG,     /* an argument or specification out of its stated range */
	DIO_BAD_FILE,    /* a file that is there and is not what it should be */
	DIO_NOT_FOUND,   /* no such file or device */
	DIO_BUSY,        /* the device is in use by another process */
	DIO_GONE,        /* the device was unplugged */
	DIO_IO,          /* the system refused a read or a write */
	DIO_NO_SPACE,    /* disk full */
	DIO_NO_MEM,      /* out of memory, or a size that overflows */
	DIO_UNSUPPORTED, /* well formed, but not offered by this device or build */
	DIO_REFUSED,     /* the data are too poor for an honest answer; the text says why */
};

/** Room for one line that names the thing, the fault and the remedy. */
struct dio_error {
	char text[512];
};

/** A constant English word or two for a status; never NULL. */
const char *dio_status_text(enum dio_status status);

/** Write the line (NULL error is fine) and hand `status` back, so that `return dio_fail(...)`
 * reads. */
__attribute__((format(printf, 3, 4))) enum dio_status
dio_fail(struct dio_error *error, enum dio_status status, const char *format, ...);

#ifdef __clang_analyzer__
/* The analyser does not look into other files: tell it that what fails is never DIO_OK. */
static inline enum dio_status dio_fail_is_failure(enum dio_status status)
{
	if (status == DIO_OK)
		__builtin_unreachable();
	return status;
}
#define dio_fail(error, status, ...) dio_fail_is_failure((dio_fail)(error, status, __VA_ARGS__))
#endif

/** The status an errno value stands for: ENOSPC, EBUSY, ENODEV, ENOENT, ENOMEM and so on. */
enum dio_status dio_status_from_errno(int errno_value);

#ifdef __cplusplus
}
#endif
#endif
