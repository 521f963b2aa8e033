# cmake -DFROM=FILE -DTO=FILE.c -DSYMBOL=NAME -P embed.cmake: a file's bytes as a C array.
file(READ ${FROM} hex HEX)
string(REGEX REPLACE "(..)" "0x\\1," bytes "${hex}")
string(REGEX REPLACE "(................................................................................)"
	"\\1\n" bytes "${bytes}")
get_filename_component(name ${FROM} NAME)
file(WRITE ${TO} "/* Made from ${name}. */\n#include \"web/page.h\"\n\n"
	"const uint8_t dio_page_${SYMBOL}[] = {\n${bytes}};\n"
	"const size_t dio_page_${SYMBOL}_size = sizeof dio_page_${SYMBOL};\n")
