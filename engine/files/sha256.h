/* SHA-256 (FIPS 180-4). Private to the engine. */
#ifndef DVSM_FILES_SHA256_H
#define DVSM_FILES_SHA256_H

#include <stddef.h>
#include <stdint.h>

/** Hex digits of a digest and the terminator. */
#define DVSM_SHA256_HEX 65

struct dvsm_sha256 {
	/* The CPU's own instructions where it has them: ten times as fast. */
	void (*compress)(uint32_t state[8], const unsigned char *blocks, size_t count);
	uint32_t state[8];
	uint64_t length; /* bytes so far */
	unsigned char block[64];
};

void dvsm_sha256_init(struct dvsm_sha256 *hash);
void dvsm_sha256_update(struct dvsm_sha256 *hash, const void *bytes, size_t size);

/** Finish; `hex` receives 64 lower-case hex digits and a terminator. Init again before reuse. */
void dvsm_sha256_finish(struct dvsm_sha256 *hash, char hex[DVSM_SHA256_HEX]);

#endif
