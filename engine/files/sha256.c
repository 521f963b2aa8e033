#include "files/sha256.h"

#include <string.h>

#include "files/sha256_compress.h"

/* First 32 bits of the fractions of the cube roots of the first 64 primes (section 4.2.2). */
const uint32_t dvsm_sha256_constants[64] = {
	0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4,
	0xab1c5ed5, 0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe,
	0x9bdc06a7, 0xc19bf174, 0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f,
	0x4a7484aa, 0x5cb0a9dc, 0x76f988da, 0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7,
	0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967, 0x27b70a85, 0x2e1b2138, 0x4d2c6dfc,
	0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85, 0xa2bfe8a1, 0xa81a664b,
	0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070, 0x19a4c116,
	0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
	0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7,
	0xc67178f2};

static uint32_t rotate_right(uint32_t value, unsigned bits)
{
	return value >> bits | value << (32 - bits);
}

static void expand_schedule(const unsigned char block[64], uint32_t w[64])
{
	for (int i = 0; i < 16; i++) {
		const unsigned char *b = block + 4 * i;
		w[i] = (uint32_t)b[0] << 24 | (uint32_t)b[1] << 16 | (uint32_t)b[2] << 8 | b[3];
	}
	for (int i = 16; i < 64; i++) {
		uint32_t a = w[i - 15], b = w[i - 2];
		uint32_t s0 = rotate_right(a, 7) ^ rotate_right(a, 18) ^ a >> 3;
		uint32_t s1 = rotate_right(b, 17) ^ rotate_right(b, 19) ^ b >> 10;
		w[i] = w[i - 16] + s0 + w[i - 7] + s1;
	}
}

/* s[0..7] are a..h. */
static void compress_block(uint32_t state[8], const unsigned char block[64])
{
	uint32_t w[64], s[8];
	expand_schedule(block, w);
	memcpy(s, state, sizeof(s));
	for (int i = 0; i < 64; i++) {
		uint32_t sum1 =
			rotate_right(s[4], 6) ^ rotate_right(s[4], 11) ^ rotate_right(s[4], 25);
		uint32_t choice = (s[4] & s[5]) ^ (~s[4] & s[6]);
		uint32_t t1 = s[7] + sum1 + choice + dvsm_sha256_constants[i] + w[i];
		uint32_t sum0 =
			rotate_right(s[0], 2) ^ rotate_right(s[0], 13) ^ rotate_right(s[0], 22);
		uint32_t majority = (s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]);
		s[7] = s[6];
		s[6] = s[5];
		s[5] = s[4];
		s[4] = s[3] + t1;
		s[3] = s[2];
		s[2] = s[1];
		s[1] = s[0];
		s[0] = t1 + sum0 + majority;
	}
	for (int i = 0; i < 8; i++)
		state[i] += s[i];
}

void dvsm_sha256_compress_scalar(uint32_t state[8], const unsigned char *blocks, size_t count)
{
	for (; count > 0; count--, blocks += 64)
		compress_block(state, blocks);
}

void dvsm_sha256_init(struct dvsm_sha256 *hash)
{
	static const uint32_t initial[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
					    0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
	memcpy(hash->state, initial, sizeof(initial));
	hash->length = 0;
	hash->compress = dvsm_sha256_find_hardware();
	if (!hash->compress)
		hash->compress = dvsm_sha256_compress_scalar;
}

void dvsm_sha256_update(struct dvsm_sha256 *hash, const void *bytes, size_t size)
{
	const unsigned char *from = bytes;
	size_t filled = hash->length % sizeof(hash->block);
	hash->length += size;
	if (filled) {
		size_t room = sizeof(hash->block) - filled;
		size_t taken = size < room ? size : room;
		if (taken)
			memcpy(hash->block + filled, from, taken);
		if (taken < room)
			return;
		hash->compress(hash->state, hash->block, 1);
		from += taken;
		size -= taken;
	}
	hash->compress(hash->state, from, size / sizeof(hash->block));
	if (size % sizeof(hash->block))
		memcpy(hash->block, from + size / 64 * 64, size % sizeof(hash->block));
}

void dvsm_sha256_finish(struct dvsm_sha256 *hash, char hex[DVSM_SHA256_HEX])
{
	static const unsigned char padding[64] = {0x80};
	uint64_t bits = hash->length * 8;
	size_t filled = hash->length % 64;
	dvsm_sha256_update(hash, padding, filled < 56 ? 56 - filled : 120 - filled);

	unsigned char length[8];
	for (int i = 0; i < 8; i++)
		length[i] = (unsigned char)(bits >> (56 - 8 * i));
	dvsm_sha256_update(hash, length, sizeof(length));

	static const char digits[] = "0123456789abcdef";
	for (int i = 0; i < 64; i++)
		hex[i] = digits[hash->state[i / 8] >> (28 - 4 * (i % 8)) & 15];
	hex[64] = '\0';
}
