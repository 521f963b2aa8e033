/* Drawing on a GPU: a block of 64 threads a tile, a row of blocks a picture. Built without fused
 * multiplication, so every operation is rounded as the CPU rounds it. */
#include "dio/sim_cuda.h"

#include <new>
#include <thread>
#include <vector>

#include "cuda/steps.h"

namespace
{

enum { LINE_THREADS = 256 };

__global__ void first_kernel(const struct shot *shots)
{
	__shared__ struct tile_block block;

	for (uint32_t phase = 0; phase < FIRST_PHASES; phase++) {
		first_phase(&shots[blockIdx.y].picture, &block, phase, blockIdx.x, threadIdx.x);
		__syncthreads();
	}
}

__global__ void mark_kernel(const struct shot *shots)
{
	mark_step(&shots[blockIdx.y].picture, blockIdx.x, threadIdx.x);
}

__global__ void refine_kernel(const struct shot *shots)
{
	refine_step(&shots[blockIdx.y].picture, blockIdx.x, threadIdx.x);
}

__global__ void across_kernel(const struct shot *shots)
{
	across_step(&shots[blockIdx.y], blockIdx.x * LINE_THREADS + threadIdx.x);
}

__global__ void develop_kernel(const struct shot *shots)
{
	develop_step(&shots[blockIdx.y], blockIdx.x * LINE_THREADS + threadIdx.x);
}

__global__ void compress_kernel(const struct shot *shots)
{
	compress_step(&shots[blockIdx.y], blockIdx.x * LINE_THREADS + threadIdx.x);
}

__global__ void deliver_kernel(const struct shot *shots)
{
	deliver_step(&shots[blockIdx.y], blockIdx.x * LINE_THREADS + threadIdx.x);
}

thread_local cudaError_t fault = cudaSuccess;

/* Remembers the first fault; work after it is passed over. */
bool good(cudaError_t status)
{
	if (fault == cudaSuccess)
		fault = status;
	return fault == cudaSuccess;
}

/* Memory of the GPU, given back in the order of the stream. */
class Device
{
      public:
	explicit Device(cudaStream_t stream) : stream(stream)
	{
	}
	Device(const Device &) = delete;
	Device &operator=(const Device &) = delete;
	~Device()
	{
		if (at)
			cudaFreeAsync(at, stream);
	}
	bool reserve(size_t bytes)
	{
		return good(cudaMallocAsync(&at, bytes ? bytes : 1, stream));
	}
	bool fill(const void *from, size_t bytes)
	{
		return reserve(bytes) &&
		       good(cudaMemcpyAsync(at, from, bytes, cudaMemcpyHostToDevice, stream));
	}
	char *get() const
	{
		return static_cast<char *>(at);
	}

      private:
	void *at = nullptr;
	cudaStream_t stream;
};

struct Batch {
	uint32_t scenes, views, width, height, options;
	std::vector<struct sim_shoot> shoots;

	size_t pixels() const
	{
		return static_cast<size_t>(width) * height;
	}
	size_t pictures() const
	{
		return static_cast<size_t>(scenes) * views;
	}
	~Batch()
	{
		for (struct sim_shoot &s : shoots)
			sim_shoot_deinit(&s);
	}
};

/* Build every `step`-th scene from `first` on; *ok is false when memory was short. */
void build_scenes(Batch *b, uint64_t seed, uint32_t first, uint32_t step, char *ok)
{
	*ok = 1;
	for (uint32_t i = first; i < b->scenes && *ok; i += step)
		*ok = sim_shoot_init(&b->shoots[i], seed + i, b->views, b->width, b->height,
				     b->options);
}

bool build(Batch *b, uint64_t seed, uint32_t threads)
{
	threads = threads < 1 ? 1 : threads > 64 ? 64 : threads;
	std::vector<std::thread> others;
	std::vector<char> ok(threads, 0);

	b->shoots.resize(b->scenes);
	for (uint32_t i = 1; i < threads; i++)
		others.emplace_back(build_scenes, b, seed, i, threads, &ok[i]);
	build_scenes(b, seed, 0, threads, &ok[0]);
	for (std::thread &t : others)
		t.join();
	for (char each : ok)
		if (!each)
			return false;
	return true;
}

void hand_out_cameras(const Batch &b, float *poses, float *intrinsics)
{
	for (size_t i = 0; i < b.pictures(); i++)
		sim_shoot_camera(&b.shoots[i / b.views], static_cast<uint32_t>(i % b.views),
				 poses + 16 * i, intrinsics + 4 * i);
}

/* Buffers of one picture, cut from one piece of memory. Called with NULL it says how long the piece
 * must be. `self` is where the shot will lie when it is used. */
size_t lay_out(const Batch &b, struct shot *s, char *memory, const struct shot *self)
{
	size_t at = 0, pixels = b.pixels();
	struct dio_sim_camera shape = {};

	shape.width = b.width;
	shape.height = b.height;
	auto place = [&](size_t bytes) {
		char *here = memory ? memory + at : nullptr;

		at += (bytes + 255) / 256 * 256;
		return here;
	};
	char *rgb = place(pixels * 3 * sizeof(float)), *across = place(pixels * 3 * sizeof(float));
	char *surface = place(pixels * sizeof(uint16_t));
	char *response = place(pixels * sizeof(struct response)), *refine = place(pixels);
	char *tiles = place(picture_tiles(&shape) * sizeof(struct tile));

	if (!memory)
		return at;
	s->picture.rgb = reinterpret_cast<float *>(rgb);
	s->picture.surface = reinterpret_cast<uint16_t *>(surface);
	s->picture.response = reinterpret_cast<struct response *>(response);
	s->picture.refine = reinterpret_cast<uint8_t *>(refine);
	s->picture.tiles = reinterpret_cast<struct tile *>(tiles);
	s->picture.camera = &self->camera;
	s->across = reinterpret_cast<float *>(across);
	return at;
}

/* Picture `i` of the batch, with buffers at `memory`, its scene at `scene`, going to `rgb`. */
void set_up(const Batch &b, size_t i, struct shot *s, char *memory, const struct shot *self,
	    const struct dio_sim_scene *scene, void *rgb)
{
	const struct sim_shoot &shoot = b.shoots[i / b.views];
	size_t values = 3 * b.pixels();

	s->camera = shoot.camera[i % b.views];
	s->sensor = shoot.sensor[i % b.views];
	s->gain = shoot.scene->exposure;
	picture_init(&s->picture, scene, &s->camera, SIM_SHOOT_SAMPLES);
	lay_out(b, s, memory, self);
	s->bytes = nullptr;
	s->floats = nullptr;
	if (b.options & DIO_SIM_BATCH_FLOAT)
		s->floats = static_cast<float *>(rgb) + i * values;
	else
		s->bytes = static_cast<uint8_t *>(rgb) + i * values;
}

dim3 blocks(size_t threads, size_t pictures)
{
	return dim3(static_cast<unsigned>((threads + LINE_THREADS - 1) / LINE_THREADS),
		    static_cast<unsigned>(pictures));
}

bool launch(const struct shot *shots, const struct dio_sim_camera &shape, size_t count,
	    cudaStream_t stream)
{
	dim3 tiles(picture_tiles(&shape), static_cast<unsigned>(count));
	size_t pixels = static_cast<size_t>(shape.width) * shape.height;

	first_kernel<<<tiles, TILE_THREADS, 0, stream>>>(shots);
	mark_kernel<<<tiles, TILE_THREADS, 0, stream>>>(shots);
	refine_kernel<<<tiles, TILE_THREADS, 0, stream>>>(shots);
	across_kernel<<<blocks(pixels, count), LINE_THREADS, 0, stream>>>(shots);
	develop_kernel<<<blocks(pixels, count), LINE_THREADS, 0, stream>>>(shots);
	compress_kernel<<<blocks(squares(&shape), count), LINE_THREADS, 0, stream>>>(shots);
	deliver_kernel<<<blocks(3 * pixels, count), LINE_THREADS, 0, stream>>>(shots);
	return good(cudaGetLastError());
}

/* Pictures drawn at once: enough to fill a large GPU, some hundred megabytes of buffers. */
size_t pictures_at_once(const Batch &b)
{
	size_t fit = (size_t{6} << 20) / b.pixels();

	return fit < 1 ? 1 : fit > 16384 ? 16384 : fit < b.pictures() ? fit : b.pictures();
}

/* Copies of the scenes that find their photographs in the memory of the GPU. */
std::vector<struct dio_sim_scene> scenes_for_device(const Batch &b, const char *photos)
{
	std::vector<struct dio_sim_scene> out(b.scenes);

	for (uint32_t i = 0; i < b.scenes; i++) {
		out[i] = *b.shoots[i].scene;
		out[i].photos.pixels = reinterpret_cast<const uint8_t *>(photos);
	}
	return out;
}

bool draw_on_device(const Batch &b, void *rgb, cudaStream_t stream)
{
	struct sim_photos photos = b.scenes ? b.shoots[0].scene->photos : sim_photos{};
	size_t at_once = pictures_at_once(b), each = lay_out(b, nullptr, nullptr, nullptr);
	Device photo_memory(stream), scene_memory(stream), shot_memory(stream), buffers(stream);
	std::vector<struct shot> shots(at_once);

	if (!photo_memory.fill(photos.pixels, photos.count * photo_bytes(photos.side)))
		return false;
	std::vector<struct dio_sim_scene> scenes = scenes_for_device(b, photo_memory.get());
	if (!scene_memory.fill(scenes.data(), scenes.size() * sizeof(scenes[0])) ||
	    !shot_memory.reserve(at_once * sizeof(struct shot)) || !buffers.reserve(at_once * each))
		return false;
	const auto *there = reinterpret_cast<const struct dio_sim_scene *>(scene_memory.get());
	auto *self = reinterpret_cast<struct shot *>(shot_memory.get());
	for (size_t first = 0; first < b.pictures(); first += at_once) {
		size_t left = b.pictures() - first, count = left < at_once ? left : at_once;

		for (size_t i = 0; i < count; i++)
			set_up(b, first + i, &shots[i], buffers.get() + i * each, self + i,
			       there + (first + i) / b.views, rgb);
		/* The copy has left `shots` when the call returns: it is not pinned. */
		if (!good(cudaMemcpyAsync(self, shots.data(), count * sizeof(shots[0]),
					  cudaMemcpyHostToDevice, stream)) ||
		    !launch(self, shots[0].camera, count, stream))
			return false;
	}
	return good(cudaStreamSynchronize(stream));
}

/* What launch() asks of the GPU for one picture. */
void walk_through(const struct shot *s)
{
	uint32_t tiles = picture_tiles(&s->camera), pixels = s->camera.width * s->camera.height;
	struct tile_block block;

	for (uint32_t tile = 0; tile < tiles; tile++)
		for (uint32_t phase = 0; phase < FIRST_PHASES; phase++)
			for (uint32_t thread = 0; thread < TILE_THREADS; thread++)
				first_phase(&s->picture, &block, phase, tile, thread);
	for (uint32_t i = 0; i < tiles * TILE_THREADS; i++)
		mark_step(&s->picture, i / TILE_THREADS, i % TILE_THREADS);
	for (uint32_t i = 0; i < tiles * TILE_THREADS; i++)
		refine_step(&s->picture, i / TILE_THREADS, i % TILE_THREADS);
	for (uint32_t i = 0; i < pixels; i++)
		across_step(s, i);
	for (uint32_t i = 0; i < pixels; i++)
		develop_step(s, i);
	for (uint32_t i = 0; i < squares(&s->camera); i++)
		compress_step(s, i);
	for (uint32_t i = 0; i < 3 * pixels; i++)
		deliver_step(s, i);
}

void draw_on_host(const Batch &b, void *rgb)
{
	std::vector<char> memory(lay_out(b, nullptr, nullptr, nullptr));
	struct shot s;

	for (size_t i = 0; i < b.pictures(); i++) {
		set_up(b, i, &s, memory.data(), &s, b.shoots[i / b.views].scene, rgb);
		walk_through(&s);
	}
}

bool sizes_hold(const Batch &b)
{
	return b.views && b.width && b.height && b.views <= SIM_SHOOT_VIEWS;
}

} // namespace

int dio_sim_cuda_devices(void)
{
	int count = 0;

	return cudaGetDeviceCount(&count) == cudaSuccess ? count : 0;
}

const char *dio_sim_cuda_fault(void)
{
	return cudaGetErrorString(fault);
}

int dio_sim_batch_cuda(int device, uint64_t seed, uint32_t scenes, uint32_t views, uint32_t width,
		       uint32_t height, uint32_t options, void *rgb, float *poses,
		       float *intrinsics, uint32_t threads, void *stream)
try {
	Batch b = {scenes, views, width, height, options, {}};

	fault = cudaSuccess;
	if (!sizes_hold(b) || !build(&b, seed, threads))
		return -1;
	hand_out_cameras(b, poses, intrinsics);
	if (!good(cudaSetDevice(device)))
		return -2;
	return draw_on_device(b, rgb, static_cast<cudaStream_t>(stream)) ? 0 : -2;
} catch (const std::exception &) {
	return -1; /* memory, or no thread to be had */
}

int dio_sim_batch_cuda_on_host(uint64_t seed, uint32_t scenes, uint32_t views, uint32_t width,
			       uint32_t height, uint32_t options, void *rgb, float *poses,
			       float *intrinsics)
try {
	Batch b = {scenes, views, width, height, options, {}};

	if (!sizes_hold(b) || !build(&b, seed, 1))
		return -1;
	hand_out_cameras(b, poses, intrinsics);
	draw_on_host(b, rgb);
	return 0;
} catch (const std::exception &) {
	return -1;
}
