#include "files/sha256.h"

#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "files/sha256_compress.h"

static void hash_of(const void *bytes, size_t size, char hex[DVSM_SHA256_HEX])
{
	struct dvsm_sha256 hash;
	dvsm_sha256_init(&hash);
	dvsm_sha256_update(&hash, bytes, size);
	dvsm_sha256_finish(&hash, hex);
}

/* FIPS 180-4 examples and NIST's long message. */
static void known_messages_have_their_known_digests(void **state)
{
	(void)state;
	static const struct {
		const char *message, *digest;
	} vectors[] = {
		{"", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"},
		{"abc", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"},
		{"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq",
		 "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1"},
		{"abcdefghbcdefghicdefghijdefghijkefghijklfghijklmghijklmnhijklmno"
		 "ijklmnopjklmnopqklmnopqrlmnopqrsmnopqrstnopqrstu",
		 "cf5b16a778af8380036ce59e7b0492370b249b11e8f07a51afac45037afee9d1"},
	};
	for (size_t i = 0; i < sizeof(vectors) / sizeof(vectors[0]); i++) {
		char hex[DVSM_SHA256_HEX];
		hash_of(vectors[i].message, strlen(vectors[i].message), hex);
		assert_string_equal(hex, vectors[i].digest);
	}
}

static void a_million_letters_a_have_their_known_digest(void **state)
{
	(void)state;
	char hex[DVSM_SHA256_HEX];
	char *letters = malloc(1000000);
	assert_non_null(letters);
	memset(letters, 'a', 1000000);
	hash_of(letters, 1000000, hex);
	free(letters);
	assert_string_equal(hex,
			    "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

static void pieces_of_any_length_give_the_digest_of_the_whole(void **state)
{
	(void)state;
	unsigned char message[300];
	for (size_t i = 0; i < sizeof(message); i++)
		message[i] = (unsigned char)(i * 7);
	for (size_t size = 0; size <= sizeof(message); size++) {
		char whole[DVSM_SHA256_HEX], pieces[DVSM_SHA256_HEX];
		hash_of(message, size, whole);
		for (size_t piece = 1; piece <= 130; piece += 13) {
			struct dvsm_sha256 hash;
			dvsm_sha256_init(&hash);
			for (size_t at = 0; at < size; at += piece)
				dvsm_sha256_update(&hash, message + at,
						   size - at < piece ? size - at : piece);
			dvsm_sha256_finish(&hash, pieces);
			assert_string_equal(pieces, whole);
		}
	}
}

static void the_cpus_own_instructions_agree_with_the_scalar_form(void **state)
{
	(void)state;
	dvsm_sha256_compress_fn *hardware = dvsm_sha256_find_hardware();
	if (!hardware) {
		print_message("this CPU has no SHA-256 instructions that we know\n");
		skip();
	}
	/* From an odd address, in states that differ each time. */
	static unsigned char bytes[1 + 64 * 9];
	for (size_t i = 0; i < sizeof(bytes); i++)
		bytes[i] = (unsigned char)(i * i * 31 + i);
	uint32_t scalar_state[8] = {1, 2, 3, 0xffffffff, 5, 6, 0x80000000, 8}, hardware_state[8];
	memcpy(hardware_state, scalar_state, sizeof(scalar_state));
	for (size_t blocks = 0; blocks <= 9; blocks++) {
		dvsm_sha256_compress_scalar(scalar_state, bytes + 1, blocks);
		hardware(hardware_state, bytes + 1, blocks);
		assert_memory_equal(hardware_state, scalar_state, sizeof(scalar_state));
	}
}

static void the_scalar_form_gives_the_known_digest(void **state)
{
	(void)state;
	struct dvsm_sha256 hash;
	char hex[DVSM_SHA256_HEX];
	dvsm_sha256_init(&hash);
	hash.compress = dvsm_sha256_compress_scalar;
	dvsm_sha256_update(&hash, "abc", 3);
	dvsm_sha256_finish(&hash, hex);
	assert_string_equal(hex,
			    "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(known_messages_have_their_known_digests),
		cmocka_unit_test(a_million_letters_a_have_their_known_digest),
		cmocka_unit_test(the_scalar_form_gives_the_known_digest),
		cmocka_unit_test(the_cpus_own_instructions_agree_with_the_scalar_form),
		cmocka_unit_test(pieces_of_any_length_give_the_digest_of_the_whole),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
