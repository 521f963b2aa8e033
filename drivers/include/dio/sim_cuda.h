/* Training scenes drawn by an NVIDIA GPU: the same scenes as dio_sim_batch(), into its memory.
 * A library of its own (libdio_sim_cuda.so, built with -DDIO_CUDA=ON), which holds all of dio/sim.h
 * and dio/sim_batch.h too. */
#ifndef DIO_SIM_CUDA_H
#define DIO_SIM_CUDA_H

#include "dio/sim_batch.h"

#ifdef __cplusplus
extern "C" {
#endif

/** GPUs that this process may use; 0 without one or without its driver. */
DIO_SIM_API int dio_sim_cuda_devices(void);

/**
 * dio_sim_batch() on a GPU. Scenes are built by the CPU, pictures drawn by the GPU.
 *
 * device   number of the GPU, from 0
 * rgb      its memory, laid out as dio_sim_batch() says
 * poses, intrinsics  host memory
 * threads  of the CPU that build scenes; 0 counts as 1
 * stream   a cudaStream_t, or NULL for the default one; done with when the call returns
 *
 * 0, -1 when memory of the CPU is short or a size is 0, -2 when CUDA fails: see
 * dio_sim_cuda_fault(). Threads may call it side by side, each with its own stream.
 */
DIO_SIM_API int dio_sim_batch_cuda(int device, uint64_t seed, uint32_t scenes, uint32_t views,
				   uint32_t width, uint32_t height, uint32_t options, void *rgb,
				   float *poses, float *intrinsics, uint32_t threads, void *stream);

/** What CUDA said when the calling thread's last batch failed. */
DIO_SIM_API const char *dio_sim_cuda_fault(void);

/**
 * The kernels' steps walked through by the CPU, in the order of their blocks and threads: what a
 * GPU would draw, for machines without one. rgb is host memory. Slow; for tests.
 */
DIO_SIM_API int dio_sim_batch_cuda_on_host(uint64_t seed, uint32_t scenes, uint32_t views,
					   uint32_t width, uint32_t height, uint32_t options,
					   void *rgb, float *poses, float *intrinsics);

#ifdef __cplusplus
}
#endif
#endif
