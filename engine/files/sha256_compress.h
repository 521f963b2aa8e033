/* The compression function of SHA-256, and its faster forms. Private to sha256. */
#ifndef DVSM_FILES_SHA256_COMPRESS_H
#define DVSM_FILES_SHA256_COMPRESS_H

#include <stddef.h>
#include <stdint.h>

/**
 * Take `count` blocks of 64 bytes, of any alignment, into the state (FIPS 180-4, section 6.2.2).
 * All forms give the same digest; scalar is the specification.
 */
typedef void dvsm_sha256_compress_fn(uint32_t state[8], const unsigned char *blocks, size_t count);

extern const uint32_t dvsm_sha256_constants[64];

dvsm_sha256_compress_fn dvsm_sha256_compress_scalar;

/** The form that uses the CPU's own SHA-256 instructions; NULL when it has none. */
dvsm_sha256_compress_fn *dvsm_sha256_find_hardware(void);

#endif
