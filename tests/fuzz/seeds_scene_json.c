/* The first corpus of fuzz_scene_json: small scenes with every key there is. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CAMERA                                                                                     \
	"\"camera\":{\"width\":64,\"height\":48,\"fx\":60.5,\"fy\":61,\"cx\":31.5,\"cy\":23.5"
#define POSE "\"world_from_camera\":[1,0,0,0.5,0,1,0,-2,0,0,1,3e1,0,0,0,1]"

static const char *const SEEDS[] = {
	"{\"name\":\"s\"," CAMERA ",\"dist\":[0.1,-0.2,0.001,0,0]},\"frames\":[{\"file\":"
	"\"images/0.png\",\"role\":\"context\"," POSE "}]}",
	"{\"frames\":[{\"file\":\"0.png\"," POSE "," CAMERA "}},{\"role\":\"target\"," POSE
	"," CAMERA ",\"dist\":[]}}]}",
	"{\"name\":\"\\u00e9\\n\"," CAMERA "},\"frames\":[{\"file\":\"a\"," POSE "},{\"file\":null,"
	"\"role\":\"target\"," POSE "}]} ",
	"{" CAMERA
	"},\"frames\":[{\"file\":\"a\",\"world_from_camera\":[0,-1,0,0,1,0,0,0,0,0,1,0,0,0,0,"
	"1]}]}",
};

int main(int argc, char **argv)
{
	if (argc != 2) {
		fprintf(stderr, "usage: seeds_scene_json FOLDER\n");
		return 2;
	}
	for (size_t i = 0; i < sizeof SEEDS / sizeof *SEEDS; i++) {
		char path[4096];
		FILE *file;

		snprintf(path, sizeof path, "%s/scene-%zu.json", argv[1], i);
		file = fopen(path, "wb");
		if (!file || fputs(SEEDS[i], file) == EOF || fclose(file) != 0) {
			perror(path);
			return 1;
		}
	}
	return 0;
}
