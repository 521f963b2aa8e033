#include "muon.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>

#include "memory.h"
#include "product.h"

enum { MAX_THREADS = 64, STEPS = 5 };

struct scratch {
	uint16_t *x, *gram, *polynomial, *left, *right;
	float *wide;
};

struct work {
	const struct dio_muon_weight *weights;
	int count;
	float rate, decay, inertia;
	size_t largest;
	atomic_int next, failed;
};

static size_t place(struct scratch *s, size_t largest, char *base)
{
	struct arena arena = {base, 0};
	uint16_t **halves[] = {&s->x, &s->gram, &s->polynomial, &s->left, &s->right};
	for (size_t i = 0; i < sizeof(halves) / sizeof(*halves); i++) {
		*halves[i] = take(&arena, largest, 2);
	}
	s->wide = take(&arena, largest, sizeof(float));
	return arena.used;
}

/* Move the momentum and write what it and the gradient say to x, at unit Frobenius norm. */
static void direction(const float *gradient, float *momentum, size_t count, float inertia,
		      struct scratch *s)
{
	__m512 keep = _mm512_set1_ps(inertia), step = _mm512_set1_ps(1 - inertia);
	__m512 squares = _mm512_setzero_ps();
	for (size_t i = 0; i < count; i += 16) {
		__m512 g = _mm512_loadu_ps(gradient + i), m = _mm512_loadu_ps(momentum + i);
		m = _mm512_fmadd_ps(_mm512_sub_ps(g, m), step, m);
		_mm512_storeu_ps(momentum + i, m);
		__m512 x = _mm512_fmadd_ps(_mm512_sub_ps(m, g), keep, g);
		squares = _mm512_fmadd_ps(x, x, squares);
		_mm512_storeu_ps(s->wide + i, x);
	}
	__m512 scale = _mm512_set1_ps(1.0f / (sqrtf(_mm512_reduce_add_ps(squares)) + 1e-30f));
	for (size_t i = 0; i < count; i += 32) {
		store_bf16(s->x + i, _mm512_mul_ps(_mm512_loadu_ps(s->wide + i), scale),
			   _mm512_mul_ps(_mm512_loadu_ps(s->wide + i + 16), scale));
	}
}

/* out = a x + b y, in bfloat16 */
static void combine(float a, const uint16_t *x, float b, const float *y, size_t count,
		    uint16_t *out)
{
	__m512 scale_x = _mm512_set1_ps(a), scale_y = _mm512_set1_ps(b);
	for (size_t i = 0; i < count; i += 32) {
		__m512 low = _mm512_mul_ps(_mm512_loadu_ps(y + i), scale_y);
		__m512 high = _mm512_mul_ps(_mm512_loadu_ps(y + i + 16), scale_y);
		store_bf16(out + i, _mm512_fmadd_ps(load_bf16(x + i), scale_x, low),
			   _mm512_fmadd_ps(load_bf16(x + i + 16), scale_x, high));
	}
}

/* x <- a x + (b G + c G^2) x, G = x x^T; from the other side where x is tall. */
static void newton_schulz(struct scratch *s, int rows, int cols)
{
	const float a = 3.4445f, b = -4.7750f, c = 2.0315f;
	int side = rows < cols ? rows : cols;
	size_t count = (size_t)rows * cols, square = (size_t)side * side;
	bool tall = rows > cols;
	if (tall) {
		pack_transposed(s->x, cols, rows, cols, s->left, rows);
		pack_pairs(s->x, cols, rows, cols, s->right, rows);
		product_transposed_bf16(s->left, s->right, rows, side, side, s->gram);
	} else {
		pack_columns(s->x, cols, rows, cols, s->right, cols);
		product_bf16(s->x, cols, s->right, cols, side, side, cols, s->gram, side);
	}
	pack_pairs(s->gram, side, side, side, s->right, side);
	product(s->gram, side, s->right, side, side, side, side, s->wide, side, false);
	combine(b, s->gram, c, s->wide, square, s->polynomial);
	if (tall) {
		pack_pairs(s->polynomial, side, side, side, s->right, side);
		product(s->x, cols, s->right, cols, rows, cols, cols, s->wide, cols, false);
	} else {
		pack_pairs(s->x, cols, rows, cols, s->right, rows);
		product(s->polynomial, side, s->right, rows, rows, cols, rows, s->wide, cols,
			false);
	}
	combine(a, s->x, 1.0f, s->wide, count, s->x);
}

static void step_part(const struct work *work, const struct dio_muon_weight *w, int part,
		      struct scratch *s)
{
	size_t count = (size_t)w->rows * w->cols, at = count * part;
	direction(w->gradient + at, w->momentum + at, count, work->inertia, s);
	for (int i = 0; i < STEPS; i++) {
		newton_schulz(s, w->rows, w->cols);
	}
	float *weight = w->weight + at, longest = (float)(w->rows > w->cols ? w->rows : w->cols);
	__m512 keep = _mm512_set1_ps(1 - work->rate * work->decay);
	__m512 rate = _mm512_set1_ps(work->rate * 0.2f * sqrtf(longest));
	for (size_t i = 0; i < count; i += 16) {
		__m512 old = _mm512_mul_ps(_mm512_loadu_ps(weight + i), keep);
		_mm512_storeu_ps(weight + i, _mm512_fnmadd_ps(load_bf16(s->x + i), rate, old));
	}
}

static void *run(void *argument)
{
	struct work *work = argument;
	struct scratch scratch;
	char *memory = allocate(place(&scratch, work->largest, NULL));
	if (!memory) {
		atomic_fetch_add(&work->failed, 1); /* the others do its share */
		return NULL;
	}
	place(&scratch, work->largest, memory);
	tiles_configure();
	for (int taken = atomic_fetch_add(&work->next, 1), at = 0, i = 0; i < work->count; i++) {
		for (; taken < at + work->weights[i].parts;
		     taken = atomic_fetch_add(&work->next, 1)) {
			step_part(work, &work->weights[i], taken - at, &scratch);
		}
		at += work->weights[i].parts;
	}
	tiles_release();
	free(memory);
	return NULL;
}

int dio_muon_step(const struct dio_muon_weight *weights, int count, float rate, float decay,
		  float inertia, int threads)
{
	struct work work = {.weights = weights,
			    .count = count,
			    .rate = rate,
			    .decay = decay,
			    .inertia = inertia};
	for (int i = 0; i < count; i++) {
		size_t rows = (size_t)weights[i].rows, cols = (size_t)weights[i].cols,
		       size = rows * cols;
		work.largest = size > work.largest ? size : work.largest;
	}
	pthread_t started[MAX_THREADS];
	int running = 0;
	for (int i = 0; i < threads && i < MAX_THREADS; i++) {
		running += pthread_create(&started[running], NULL, run, &work) == 0;
	}
	for (int i = 0; i < running; i++) {
		pthread_join(started[i], NULL);
	}
	return atomic_load(&work.failed) < running ? 0 : -1;
}
