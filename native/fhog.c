/* FHOG cells and linear models on them, fast. cues/heads/fhog.py and head_model.py define what they are;
 * cues/heads/native.py calls these and checks all sizes. C99 with the vectors of GCC and Clang. No state; reentrant. */

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define LANES 8  /* floats that are added at once */
#define BLOCK 8  /* neighbouring windows that share each load of the weights */
#define MOST_BINS 18
#define STEEPEST 255
#define CLIP 0.2f
#define EPSILON 1e-4f
#define ENERGY_SCALE 0.23570226f /* 1 / sqrt(18) */

/* One build runs everywhere and takes the wide registers where there are some. */
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__clang__) && !defined(FHOG_PORTABLE)
#define FOR(feature) __attribute__((target_clones(feature, "default")))
#else
#define FOR(feature)
#endif
#define INLINE static inline __attribute__((always_inline))

typedef float lanes __attribute__((vector_size(4 * LANES), aligned(4)));

INLINE float smaller(float a, float b) { return a < b ? a : b; }

/* Gradients of one line between its outermost pixels: strengths, and where in a cell's histogram they belong. */
INLINE void gradients(const uint8_t *line, ptrdiff_t stride, int width, const uint8_t *table, float *strengths,
                      uint8_t *directions) {
  for (int x = 1; x < width - 1; x++) {
    const int right = line[x + 1] - line[x - 1], down = line[x + stride] - line[x - stride];
    strengths[x] = sqrtf((float)(right * right + down * down));
  }
  for (int x = 1; x < width - 1; x++) {
    const int right = line[x + 1] - line[x - 1], down = line[x + stride] - line[x - stride];
    directions[x] = table[(down + STEEPEST) * (2 * STEEPEST + 1) + right + STEEPEST];
  }
}

/* Share one line's gradients among the histograms of the cells above and below, each with a margin of one cell. */
INLINE void gather(const float *strengths, const uint8_t *directions, int width, int cell, int bins2, float below,
                   const float *afters, const int *places, float *upper, float *lower) {
  (void)cell;
  for (int x = 1; x < width - 1; x++) {
    const float down = strengths[x] * below, up = strengths[x] - down, after = afters[x];
    const int place = places[x] + directions[x];
    const float up_after = up * after, down_after = down * after;
    upper[place] += up - up_after;
    upper[place + bins2] += up_after;
    lower[place] += down - down_after;
    lower[place + bins2] += down_after;
  }
}

/* One cell's descriptor; `norms` of the 2x2 cells to its upper left, upper right, lower left, lower right. */
INLINE float *describe(const float *histogram, const float *norms, int bins, int is_signed, int is_unsigned,
                       float *out) {
  float sums[2 * MOST_BINS], unsigned_sums[MOST_BINS], energies[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  for (int b = 0; b < 2 * bins; b++) {
    const float value = histogram[b];
    float clipped[4];
    for (int k = 0; k < 4; k++) clipped[k] = smaller(value * norms[k], CLIP);
    for (int k = 0; k < 4; k++) energies[k] += clipped[k];
  }
  if (is_signed) {
    for (int b = 0; b < 2 * bins; b++)
      sums[b] = 0.5f * (smaller(histogram[b] * norms[0], CLIP) + smaller(histogram[b] * norms[1], CLIP) +
                        smaller(histogram[b] * norms[2], CLIP) + smaller(histogram[b] * norms[3], CLIP));
    memcpy(out, sums, 2 * bins * sizeof(float));
    out += 2 * bins;
  }
  if (is_unsigned) {
    for (int b = 0; b < bins; b++) {
      const float value = histogram[b] + histogram[b + bins];
      unsigned_sums[b] = 0.5f * (smaller(value * norms[0], CLIP) + smaller(value * norms[1], CLIP) +
                                 smaller(value * norms[2], CLIP) + smaller(value * norms[3], CLIP));
    }
    memcpy(out, unsigned_sums, bins * sizeof(float));
    out += bins;
  }
  for (int k = 0; k < 4; k++) out[k] = ENERGY_SCALE * energies[k];
  return out + 4;
}

INLINE void describe_line(const float *histograms, const float *norms, int cols, int bins, int is_signed,
                          int is_unsigned, float *out) {
  for (int col = 0; col < cols; col++)
    out = describe(histograms + (ptrdiff_t)col * 2 * bins, norms + (ptrdiff_t)col * 4, bins, is_signed, is_unsigned, out);
}

/* All arrays of one call, in one piece of memory. */
struct scratch {
  float *histograms, *energies, *norms, *strengths, *afters;
  int *places;
  uint8_t *directions;
};

/* Descriptors (rows, cols, D) of the whole cells in (height, width) pixels whose lines are `stride` bytes apart.
 * `table`: direction of each gradient, 511 x 511. Returns 0, or -1 where memory is short. */
FOR("avx2") int fhog_cells(const uint8_t *pixels, int height, int width, ptrdiff_t stride, int cell, int bins, int is_signed,
                    int is_unsigned, const uint8_t *table, float *out) {
  const int rows = height / cell, cols = width / cell, bins2 = 2 * bins;
  const ptrdiff_t line = (ptrdiff_t)(cols + 2) * bins2; /* of histograms with their margin */
  if (rows == 0 || cols == 0) return 0;
  height = rows * cell;
  width = cols * cell;

  const size_t cells = (size_t)(rows + 2) * (size_t)line, energy_count = (size_t)(rows + 2) * (size_t)(cols + 2);
  float *memory = calloc(cells + energy_count + 4 * (size_t)cols + 4 * (size_t)width, sizeof(float));
  if (memory == NULL) return -1;
  struct scratch s;
  s.histograms = memory;
  s.energies = s.histograms + cells;
  s.norms = s.energies + energy_count;
  s.strengths = s.norms + 4 * (size_t)cols;
  s.afters = s.strengths + width;
  s.places = (int *)(s.afters + width);
  s.directions = (uint8_t *)(s.places + width);

  for (int x = 0; x < width; x++) {
    const float place = ((float)x + 0.5f) / (float)cell + 0.5f; /* in cells, the margin's included */
    const int before = (int)place;
    s.places[x] = before * bins2;
    s.afters[x] = place - (float)before;
  }
  for (int y = 1; y < height - 1; y++) {
    const float place = ((float)y + 0.5f) / (float)cell + 0.5f;
    const int before = (int)place;
    float *upper = s.histograms + before * line;
    gradients(pixels + y * stride, stride, width, table, s.strengths, s.directions);
    gather(s.strengths, s.directions, width, cell, bins2, place - (float)before, s.afters, s.places, upper, upper + line);
  }

  for (int row = 1; row <= rows; row++)
    for (int col = 1; col <= cols; col++) {
      const float *histogram = s.histograms + row * line + (ptrdiff_t)col * bins2;
      float energy = 0.0f;
      for (int b = 0; b < bins; b++) {
        const float value = histogram[b] + histogram[b + bins];
        energy += value * value;
      }
      s.energies[(ptrdiff_t)row * (cols + 2) + col] = energy;
    }
  for (int row = 1; row <= rows; row++) { /* beyond the edge the outermost cells go on */
    float *energies = s.energies + (ptrdiff_t)row * (cols + 2);
    energies[0] = energies[1];
    energies[cols + 1] = energies[cols];
  }
  memcpy(s.energies, s.energies + cols + 2, (size_t)(cols + 2) * sizeof(float));
  memcpy(s.energies + (ptrdiff_t)(rows + 1) * (cols + 2), s.energies + (ptrdiff_t)rows * (cols + 2),
         (size_t)(cols + 2) * sizeof(float));

  const ptrdiff_t dimensions = (2 * is_signed + is_unsigned) * bins + 4;
  for (int row = 0; row < rows; row++) {
    const float *a = s.energies + (ptrdiff_t)row * (cols + 2), *b = a + cols + 2, *c = b + cols + 2;
    for (int col = 0; col < cols; col++, a++, b++, c++) {
      const float upper_left = a[0] + a[1] + b[0] + b[1], upper_right = a[1] + a[2] + b[1] + b[2];
      const float lower_left = b[0] + b[1] + c[0] + c[1], lower_right = b[1] + b[2] + c[1] + c[2];
      s.norms[4 * col] = 1.0f / sqrtf(upper_left + EPSILON);
      s.norms[4 * col + 1] = 1.0f / sqrtf(upper_right + EPSILON);
      s.norms[4 * col + 2] = 1.0f / sqrtf(lower_left + EPSILON);
      s.norms[4 * col + 3] = 1.0f / sqrtf(lower_right + EPSILON);
    }
    const float *histograms = s.histograms + (row + 1) * line + bins2;
    float *descriptors = out + row * cols * dimensions;
    /* With the usual numbers of bins known, the compiler unrolls. */
    if (bins == 6 && is_signed && is_unsigned)
      describe_line(histograms, s.norms, cols, 6, 1, 1, descriptors);
    else if (bins == 9 && is_signed && is_unsigned)
      describe_line(histograms, s.norms, cols, 9, 1, 1, descriptors);
    else if (bins == 4 && is_signed && is_unsigned)
      describe_line(histograms, s.norms, cols, 4, 1, 1, descriptors);
    else
      describe_line(histograms, s.norms, cols, bins, is_signed, is_unsigned, descriptors);
  }
  free(memory);
  return 0;
}

/* Products of `count` neighbouring windows' cells in one line with the weights of LANES window rows. */
INLINE void multiply(const float *cells, ptrdiff_t dimensions, int length, const float *weights, ptrdiff_t columns,
                     int count, float *products) {
  lanes sums[BLOCK];
#pragma GCC unroll 8
  for (int n = 0; n < count; n++) sums[n] = (lanes){0};
  for (int i = 0; i < length; i++) {
    lanes weight;
    memcpy(&weight, weights + i * columns, sizeof weight);
#pragma GCC unroll 8
    for (int n = 0; n < count; n++) sums[n] += cells[n * dimensions + i] * weight;
  }
#pragma GCC unroll 8
  for (int n = 0; n < count; n++) memcpy(products + n * columns, &sums[n], sizeof sums[n]);
}

/* Scores of all windows of several models of one size on cells (rows, cols, dimensions).
 * `weights`: (window_cols * dimensions, columns), where column model * window_rows + row holds that row of that
 * model's window; `columns` is a multiple of LANES, columns beyond the last model are zero. `out`: (models,
 * rows - window_rows + 1, cols - window_cols + 1). Returns 0, or -1 where memory is short. */
FOR("fma") int fhog_scores(const float *cells, int rows, int cols, int dimensions, const float *weights,
                     const float *biases, int models, int window_rows, int window_cols, int columns, float *out) {
  const int down = rows - window_rows + 1, across = cols - window_cols + 1, length = window_cols * dimensions;
  if (down <= 0 || across <= 0) return 0;
  float *products = malloc((size_t)across * (size_t)columns * sizeof(float));
  if (products == NULL) return -1;
  for (int model = 0; model < models; model++)
    for (ptrdiff_t n = 0; n < (ptrdiff_t)down * across; n++) out[(ptrdiff_t)model * down * across + n] = biases[model];

  for (int row = 0; row < rows; row++) {
    const float *line = cells + (ptrdiff_t)row * cols * dimensions;
    /* The last block overlaps the one before it: fewer windows at once take as long. */
    for (int col = 0; across >= BLOCK && col < across; col += BLOCK) {
      const int begin = col + BLOCK <= across ? col : across - BLOCK;
      for (int first = 0; first < columns; first += LANES)
        multiply(line + (ptrdiff_t)begin * dimensions, dimensions, length, weights + first, columns, BLOCK,
                 products + (ptrdiff_t)begin * columns + first);
    }
    for (int col = 0; across < BLOCK && col < across; col++)
      for (int first = 0; first < columns; first += LANES)
        multiply(line + (ptrdiff_t)col * dimensions, dimensions, length, weights + first, columns, 1,
                 products + (ptrdiff_t)col * columns + first);
    /* This line of cells is row `part` of the windows that begin `part` lines above. */
    for (int model = 0; model < models; model++)
      for (int part = 0; part < window_rows; part++) {
        const int top = row - part;
        if (top < 0 || top >= down) continue;
        float *scores = out + ((ptrdiff_t)model * down + top) * across;
        const float *product = products + (ptrdiff_t)model * window_rows + part;
        for (int x = 0; x < across; x++) scores[x] += product[(ptrdiff_t)x * columns];
      }
  }
  free(products);
  return 0;
}

/* Scores of single windows on cells (rows, cols, dimensions), each of a model of its own: window n begins at the cell
 * `tops[n]`, `lefts[n]` and is scored by model `models[n]`. `weights`: (models, window_rows, window_cols *
 * dimensions). `out`: (count). */
FOR("fma") void fhog_scores_at(const float *cells, int cols, int dimensions, const int32_t *tops, const int32_t *lefts,
                               const int32_t *models, int count, const float *weights, const float *biases,
                               int window_rows, int window_cols, float *out) {
  const int length = window_cols * dimensions, whole = length - length % LANES;
  const ptrdiff_t stride = (ptrdiff_t)cols * dimensions;
  for (int n = 0; n < count; n++) {
    const float *line = cells + tops[n] * stride + (ptrdiff_t)lefts[n] * dimensions;
    const float *weight = weights + (ptrdiff_t)models[n] * window_rows * length;
    lanes sums = {0};
    float rest = biases[models[n]];
    for (int row = 0; row < window_rows; row++, line += stride, weight += length) {
      for (int i = 0; i < whole; i += LANES) {
        lanes values, factors;
        memcpy(&values, line + i, sizeof values);
        memcpy(&factors, weight + i, sizeof factors);
        sums += values * factors;
      }
      for (int i = whole; i < length; i++) rest += line[i] * weight[i];
    }
    for (int i = 0; i < LANES; i++) rest += sums[i];
    out[n] = rest;
  }
}
