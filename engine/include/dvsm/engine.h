/* The engine: reconstruct posed pictures into a KV-cache (a scene), render viewpoints from it. */
#ifndef DVSM_ENGINE_H
#define DVSM_ENGINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dvsm/camera.h"
#include "dvsm/model.h"
#include "dvsm/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Instruction-set tiers; the mask says which may be used. A tier comes with those it builds on. */
enum dvsm_cpu {
	DVSM_CPU_SCALAR = 1u << 0,       /* always present: the specification */
	DVSM_CPU_SSE2 = 1u << 1,         /* every x86-64 */
	DVSM_CPU_AVX2 = 1u << 2,         /* AVX2 and FMA */
	DVSM_CPU_AVX512 = 1u << 3,       /* AVX-512 F, BW, DQ, VL */
	DVSM_CPU_NEON = 1u << 4,         /* every aarch64 */
	DVSM_CPU_VNNI = 1u << 5,         /* AVX-512 VNNI: products of bytes */
	DVSM_CPU_AVX512_BF16 = 1u << 6,  /* AVX-512 BF16 */
	DVSM_CPU_AMX_INT8 = 1u << 7,     /* AMX tiles of bytes, with AVX-512 VNNI */
	DVSM_CPU_AMX_BF16 = 1u << 8,     /* AMX tiles of bfloat16, with AVX-512 BF16 */
	DVSM_CPU_NEON_DOTPROD = 1u << 9, /* Armv8.2 dot products of bytes */
	DVSM_CPU_NEON_I8MM = 1u << 10,   /* Armv8.6 matrix products of bytes */
	DVSM_CPU_NEON_BF16 = 1u << 11,   /* Armv8.6 bfloat16 */
	DVSM_CPU_AVX_VNNI = 1u << 12,    /* AVX-VNNI: products of bytes without AVX-512 */
	DVSM_CPU_SSE4 = 1u << 13,        /* SSSE3 and SSE4.1: x86-64 without AVX */
	DVSM_CPU_ALL = 0xffffffffu,
};

/**
 * Tiers that this CPU and operating system offer (CPUID and XCR0, or HWCAP). AMX also needs the
 * system's permission, which this asks for: it then holds for the whole process.
 */
DVSM_API uint32_t dvsm_cpu_detect(void);

/**
 * Name of the best tier in a mask: "scalar", "sse2", "sse4", "avx2", "avxvnni", "avx512",
 * "vnni", "avx512bf16", "amx", "neon", "dotprod", "i8mm", "neonbf16".
 */
DVSM_API const char *dvsm_cpu_name(uint32_t mask);

/**
 * Opaque. One engine runs one call at a time (thread-bound); several engines may share a model, and
 * those of one precision share one copy of its weights.
 */
struct dvsm_engine;

/** Opaque: KV-cache, context cameras, normalisation. Immutable; may be shared by engines. */
struct dvsm_scene;

/** Zero-initialised means: as many threads as the process may use, every tier, float32. */
struct dvsm_engine_options {
	uint32_t threads; /* 0: all that sched_getaffinity allows; at most 256 */
	/* 0: DVSM_CPU_ALL; tiers not present are ignored. In bf16 a scene lies as the tier that
	 * made it reads it, AMX or not: for the other kind each rendering makes a copy. */
	uint32_t cpu_mask;
	enum dvsm_precision precision;
	/* Even out the steps between patches of rendered pictures (deblocking). Not in MODEL.md:
	 * without it pictures are exactly the model's. */
	bool deblock;
};

/** Bytes planned before a run; what is planned is what is used. */
struct dvsm_memory {
	size_t weights_bytes; /* what the model keeps, and the set that engines of its kind share */
	size_t cache_bytes;   /* keys and values; in fixed also the first block's keys in planes */
	size_t workspace_bytes; /* the larger of the two stages */
};

/** What a call did and how long it took (CLOCK_MONOTONIC). */
struct dvsm_stats {
	uint32_t views;  /* context views */
	uint32_t tokens; /* tokens of the picture(s) processed */
	uint64_t keys;   /* cross-view keys per head and layer */
	uint64_t time_ns;
	/* In fixed: colours beyond +-128, which were clamped. Nothing else can leave its integer:
	 * bounds that follow from the weights place every binary point. */
	uint64_t saturated;
	struct dvsm_memory memory;
};

/** Called between blocks with the share done, [0,1], on the caller's thread; false cancels. */
typedef bool dvsm_progress_fn(void *context, double done);

/**
 * Create an engine with its thread pool. The model is borrowed and must outlive the engine.
 * Results do not depend on the number of threads.
 *
 * DVSM_UNSUPPORTED  this build does not have the precision, or the model was opened for another; in
 *                   fixed, weights so uneven that tokens would vanish beside what the blocks may
 *                   add to them
 */
DVSM_API enum dvsm_status dvsm_engine_create(const struct dvsm_model *model,
					     const struct dvsm_engine_options *options,
					     struct dvsm_engine **engine, struct dvsm_error *error);
DVSM_API void dvsm_engine_destroy(struct dvsm_engine *engine);

/** The tier in use, the number of threads and the precision, for reports. */
DVSM_API const char *dvsm_engine_get_cpu(const struct dvsm_engine *engine);
DVSM_API uint32_t dvsm_engine_get_threads(const struct dvsm_engine *engine);
DVSM_API enum dvsm_precision dvsm_engine_get_precision(const struct dvsm_engine *engine);

/**
 * Plan the memory of a job without allocating it.
 *
 * cameras      [views] context cameras (sizes only matter)
 * patch_px     stage patch of reconstruction p1, 0 for the model's q
 * target       the largest target camera, or NULL for none
 * target_patch_px  stage patch of rendering p2, 0 for q
 *
 * DVSM_NO_MEM  the sizes overflow
 */
DVSM_API enum dvsm_status dvsm_plan(const struct dvsm_engine *engine,
				    const struct dvsm_camera *cameras, uint32_t views,
				    uint32_t patch_px, const struct dvsm_camera *target,
				    uint32_t target_patch_px, struct dvsm_memory *memory,
				    struct dvsm_error *error);

/**
 * Reconstruct a scene from posed pictures (MODEL.md sections 2 to 4).
 *
 * views      [count], count >= 1; all may differ in size; borrowed for the call
 * patch_px   stage patch p1, 0 for the model's q; 1..256
 * progress   NULL, or called between blocks
 * scene      receives the scene; release with dvsm_scene_destroy()
 * stats      NULL, or filled
 *
 * DVSM_BAD_ARG      no views, a camera out of range, a pose that is not rigid (> 1e-3), a
 *                   colour that is not finite or outside -1..2; the text names the view
 * DVSM_UNSUPPORTED  a model with a prior (features are not computed here)
 */
DVSM_API enum dvsm_status dvsm_reconstruct(struct dvsm_engine *engine,
					   const struct dvsm_view *views, uint32_t count,
					   uint32_t patch_px, dvsm_progress_fn *progress,
					   void *progress_context, struct dvsm_scene **scene,
					   struct dvsm_stats *stats, struct dvsm_error *error);

/**
 * Reserve the workspace for rendering pictures up to `target`'s size, so that dvsm_render()
 * allocates nothing.
 */
DVSM_API enum dvsm_status dvsm_render_reserve(struct dvsm_engine *engine,
					      const struct dvsm_scene *scene,
					      const struct dvsm_camera *target, uint32_t patch_px,
					      struct dvsm_error *error);

/**
 * Render one viewpoint (MODEL.md sections 3 to 5).
 *
 * camera     pinhole, world_from_camera in the frame of the context poses
 * patch_px   stage patch p2, 0 for the model's q; 1..256
 * out        [height][width][3] float, caller's memory, unclamped
 *
 * The workspace grows when dvsm_render_reserve() was not called for this size.
 *
 * DVSM_BAD_ARG   non-finite or non-rigid pose, focal length <= 0, 1e9 rig sizes away
 * DVSM_MISMATCH  the scene was made with another model than the engine's
 */
DVSM_API enum dvsm_status dvsm_render(struct dvsm_engine *engine, const struct dvsm_scene *scene,
				      const struct dvsm_camera *camera, uint32_t patch_px,
				      float *out, struct dvsm_stats *stats,
				      struct dvsm_error *error);

/**
 * The same, clamped to 0..1 and rounded to bytes: 255 rgb, halves up.
 *
 * out        [height][width][3], caller's memory
 */
DVSM_API enum dvsm_status dvsm_render_rgb8(struct dvsm_engine *engine,
					   const struct dvsm_scene *scene,
					   const struct dvsm_camera *camera, uint32_t patch_px,
					   uint8_t *out, struct dvsm_stats *stats,
					   struct dvsm_error *error);

/** Where a picture goes: to one of the two, [height][width][3], caller's memory. */
struct dvsm_picture_out {
	float *rgb;     /* unclamped */
	uint8_t *bytes; /* clamped to 0..1 and rounded: 255 rgb, halves up */
};

/**
 * How many viewpoints of a camera's size dvsm_render_batch() is best given at once: enough for 256
 * tokens a thread, at most 16, and no more than are worked at in one go (see below). With fewer
 * than two, views are large enough one by one, and it is 1.
 */
DVSM_API uint32_t dvsm_render_batch_size(const struct dvsm_engine *engine,
					 const struct dvsm_camera *camera, uint32_t patch_px);

/**
 * Reserve the workspace for a batch of these, so that dvsm_render_batch() allocates nothing. It has
 * room for the viewpoints that are worked at in one go, of together at most 2048 tokens, in fixed
 * 512, unless one has more by itself: about 32 D bytes a token, in fixed 46 D.
 *
 * cameras  [count], as there
 */
DVSM_API enum dvsm_status dvsm_render_batch_reserve(struct dvsm_engine *engine,
						    const struct dvsm_scene *scene,
						    const struct dvsm_camera *cameras,
						    uint32_t count, uint32_t patch_px,
						    struct dvsm_error *error);

/**
 * Render several viewpoints: the same bits as one by one, with weights and the scene read less
 * often and the work shared more evenly among the threads.
 *
 * cameras  [count], count >= 1; they may differ in size
 * out      [count]
 * stats    NULL, or of all of them together
 *
 * Otherwise as dvsm_render(); one that is refused keeps all from being rendered, and the text says
 * which.
 */
DVSM_API enum dvsm_status dvsm_render_batch(struct dvsm_engine *engine,
					    const struct dvsm_scene *scene,
					    const struct dvsm_camera *cameras, uint32_t count,
					    uint32_t patch_px, const struct dvsm_picture_out *out,
					    struct dvsm_stats *stats, struct dvsm_error *error);

/** What precisions are compared on: a scene, reconstructed, and some of its viewpoints, rendered.
 */
struct dvsm_measure_job {
	const struct dvsm_model *model;
	const struct dvsm_view *views; /* [view_count] */
	uint32_t view_count, patch_recon;
	const struct dvsm_camera *targets; /* [target_count], or NULL */
	uint32_t target_count, patch_render;
	uint32_t threads; /* 0: all */
};

/**
 * How far fixed is from float32 in half a block, with all that came before it: 10 log10 of
 * float32's squares over the differences', over rows of tokens at equal distances. Keys less their
 * mean, and values, are as int8 holds them. NaN where nothing was computed.
 */
struct dvsm_half_error {
	double keys_db, values_db, attention_db, hidden_db, output_db;
};

/**
 * Run a scene in float32 and in fixed and compare what their blocks compute.
 *
 * errors  receives [2 layers]: intra-view and cross-view half of each block
 *
 * DVSM_UNSUPPORTED  a model that fixed does not take
 */
DVSM_API enum dvsm_status dvsm_activations_measure(const struct dvsm_measure_job *job,
						   struct dvsm_half_error *errors,
						   struct dvsm_error *error);

#ifdef __cplusplus
}
#endif
#endif
