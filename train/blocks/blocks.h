/*
 * The blocks of the network (MODEL.md, section 4), forward and backward, for training on a
 * processor with AVX-512, best with AMX or AVX512-BF16: products of bfloat16, float32 sums,
 * residual stream and gradients.
 */
#pragma once

#define DIO_BLOCKS_API __attribute__((visibility("default")))

struct dio_blocks;

/* What ablations change (train/ablate.py). */
enum {
	DIO_BLOCKS_TWO_STAGES = 1, /* target rows have weights of their own, behind the others */
	DIO_BLOCKS_LONE_VIEWS = 2, /* context views attend to themselves alone */
};

/** 1 where the processor and the kernel offer what the functions below need, else 0. */
DIO_BLOCKS_API int dio_blocks_supported(void);

/**
 * A network of `layers` blocks, `dim` wide, heads of 64 (dim = 64 heads), hidden width 4 dim,
 * trained by `threads` threads; `options` is a sum of the above. The handle is thread-bound.
 *
 * NULL: another head size, no support, no memory. Release with dio_blocks_destroy().
 */
DIO_BLOCKS_API struct dio_blocks *dio_blocks_create(int dim, int heads, int layers, float eps,
						    int threads, unsigned options);

DIO_BLOCKS_API void dio_blocks_destroy(struct dio_blocks *blocks);

/**
 * Pass embedded tokens through all blocks.
 *
 * weights  16 tensors a block, in the model file's order: intra norm, qkv, q_norm, k_norm, out,
 * MLP's norm, up, down; cross the same. Norms are read again by dio_blocks_backward() given
 * [scenes][context][near][dim]: tokens of the context views asked    [scenes][targets][far][dim]:
 * tokens of the target views y        in asked's shape
 *
 * Returns 0, or -1 without memory or threads, or for a shape with a zero.
 */
DIO_BLOCKS_API int dio_blocks_forward(struct dio_blocks *blocks, const float *const *weights,
				      int scenes, int context, int near, int targets, int far,
				      const float *given, const float *asked, float *y);

/**
 * The gradients of the last dio_blocks_forward(), for the gradient dy of its y: of the tokens, and
 * one tensor for each weight, overwritten. With several threads the sums over scenes are taken in
 * the order in which threads came by them.
 *
 * Returns 0, or -1 without threads or a forward pass before it.
 */
DIO_BLOCKS_API int dio_blocks_backward(struct dio_blocks *blocks, const float *dy, float *dgiven,
				       float *dasked, float *const *gradients);
