/* For a CPU family whose SHA-256 instructions we do not know. */
#include "files/sha256_compress.h"

dvsm_sha256_compress_fn *dvsm_sha256_find_hardware(void)
{
	return NULL;
}
