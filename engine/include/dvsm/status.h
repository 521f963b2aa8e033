/* Status codes and error texts of libdvsm. */
#ifndef DVSM_STATUS_H
#define DVSM_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

#define DVSM_API __attribute__((visibility("default")))

/** Every function that can fail returns one of these; outputs stay untouched unless it is DVSM_OK.
 */
enum dvsm_status {
	DVSM_OK = 0,
	DVSM_BAD_ARG,  /* an argument out of its stated range: NULL, non-finite pose, focal <= 0 */
	DVSM_BAD_FILE, /* a file that is there and is not what it should be */
	DVSM_IO,       /* the system refused: not found, permission, disk full */
	DVSM_NO_MEM,   /* memory, or a size that does not fit the address space */
	DVSM_MISMATCH, /* a scene made with another model */
	DVSM_UNSUPPORTED, /* well formed, but this build or CPU cannot do it */
	DVSM_CANCELLED,   /* the caller's progress function asked to stop */
};

/** Room for one line of text that names the thing, the fault and the remedy. */
struct dvsm_error {
	char text[512];
};

/** A constant English word or two for a status; never NULL. */
DVSM_API const char *dvsm_status_text(enum dvsm_status status);

#ifdef __cplusplus
}
#endif
#endif
