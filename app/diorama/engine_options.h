/* The options of every sub-command that runs the engine, so that they read the same everywhere. */
#ifndef DIO_DIORAMA_ENGINE_OPTIONS_H
#define DIO_DIORAMA_ENGINE_OPTIONS_H

/* Rows of a struct dio_option table; `s` is a struct dio_session_options. */
#define DIO_OPTION_MODEL(s)                                                                        \
	{                                                                                          \
		"model", DIO_OPTION_TEXT, "FILE",                                                  \
			"weights, safetensors (default: the shipped model)", &(s).model, 0, 0,     \
			false                                                                      \
	}
#define DIO_OPTION_PATCH_RECON(s)                                                                  \
	{                                                                                          \
		"patch-recon", DIO_OPTION_PATCH, "P",                                              \
			"patch side of reconstruction in pixels (default: auto)",                  \
			&(s).patch_recon, 0, 0, false                                              \
	}
#define DIO_OPTION_PATCH_RENDER(s)                                                                 \
	{                                                                                          \
		"patch-render", DIO_OPTION_PATCH, "P",                                             \
			"patch side of rendering in pixels (default: auto)", &(s).patch_render, 0, \
			0, false                                                                   \
	}
#define DIO_OPTION_THREADS(s)                                                                      \
	{                                                                                          \
		"threads", DIO_OPTION_COUNT, "N",                                                  \
			"threads; 0 takes all cores (default: 0). Pictures do not depend on it",   \
			&(s).threads, 0, 256, false                                                \
	}
#define DIO_OPTION_CPU(s)                                                                          \
	{                                                                                          \
		"cpu", DIO_OPTION_TIER, "TIER",                                                    \
			"highest instruction set: auto, scalar, sse2, sse4, avx2, avxvnni,\n"      \
			"avx512, vnni, avx512bf16, amx, neon, dotprod, i8mm, neonbf16\n"           \
			"(default: auto)",                                                         \
			&(s).cpu_mask, 0, 0, false                                                 \
	}
#define DIO_OPTION_PRECISION(s)                                                                    \
	{                                                                                          \
		"precision", DIO_OPTION_ARITHMETIC, "P",                                           \
			"f32, bf16, or fixed: integers alone, the same picture on every\n"         \
			"machine (default: f32)",                                                  \
			&(s).precision, 0, 0, false                                                \
	}
#define DIO_OPTION_DEBLOCKING(s)                                                                   \
	{                                                                                          \
		"deblock", DIO_OPTION_DEBLOCK, "WHEN",                                             \
			"auto, on, off: even out the steps between patches of rendered\n"          \
			"pictures (default: auto, as NAME.json beside the model says)",            \
			&(s).deblock, 0, 0, false                                                  \
	}

/* What `auto` does; part of a --help. */
#define DIO_HELP_PATCH                                                                             \
	"Patches: smaller ones are sharper and slower. `auto` takes the patch that gives a view\n" \
	"as many tokens as the weights were trained with: \"tokens_per_view\" in NAME.json "       \
	"beside\n"                                                                                 \
	"NAME.safetensors. A model without that file gets its own patch size."

#endif
