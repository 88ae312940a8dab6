/* The filter and the tests of jumps of smoother.py, which calls it: a rate in each lane. The numbers are those
   of its numpy, in the order of its operations. */
#include <stddef.h>
typedef long long N;
typedef double D;
typedef V U __attribute__((aligned(8)));  /* wherever an array of numbers begins */
typedef struct {
  N count, m, c, rates;
  const D *added;     /* (count, m, m + c) */
  const D *variance;  /* (count - 1, m, rates) */
  const char *jumps;  /* (count - 1, m) */
} Series;

/* Of n lanes. */
static V load(const D *from, N n) {
  if (n >= LANES) return *(const U *)from;
  V r = zb_all(from[0]);
  for (N l = 1; l < n; ++l) r[l] = from[l];
  return r;
}
static void store(D *to, V a, N n) {
  if (n >= LANES) *(U *)to = a;
  else for (N l = 0; l < n; ++l) to[l] = a[l];
}

/* n rates from k on, the results from the first or from the last: `kept` (count, m, m + c) is what is known
   before each, `explained` (c, c), `totals` (count, m, rates) unless NULL,
   what each is eliminated with; work: (m + 2, m + c). */
static void filter(const Series *s, int backward, N k, N n, U *kept, U *explained, D *totals, U *work) {
  N m = s->m, c = s->c, w = m + c, K = s->rates;
  U *known = work, *row = known + m * w, *own = row + w;
  for (N i = 0; i < m * w; ++i) known[i] = zb_all(0.0);
  for (N i = 0; i < c * c; ++i) explained[i] = zb_all(0.0);
  for (N t = 0; t < s->count; ++t) {
    const D *added = s->added + (backward ? s->count - 1 - t : t) * m * w;
    N interval = backward ? s->count - 2 - t : t, last = t == s->count - 1;
    for (N i = 0; i < m * w; ++i) kept[t * m * w + i] = known[i], known[i] += added[i];
    for (N j = 0; j < m; ++j) {
      N at = interval * m + j, walks = !last && !s->jumps[at];
      V step = walks ? 1.0 / load(s->variance + at * K + k, n) : zb_all(0.0);
      V total = known[j * w + j] + step, share = step / total, root = zb_sqrt(total);
      if (totals) store(totals + (t * m + j) * K + k, total, n);
      for (N q = 0; q < w; ++q) own[q] = known[j * w + q] * share, row[q] = known[j * w + q] / root;
      for (N a = 0; a < c; ++a)
        for (N b = 0; b < c; ++b) explained[a * c + b] += row[m + a] * row[m + b];
      for (N i = 0; i < m; ++i)
        for (N q = 0; q < w; ++q) known[i * w + q] -= row[i] * row[q];
      for (N q = 0; q < w; ++q) known[j * w + q] = own[q];
      for (N i = 0; i < m; ++i) known[i * w + j] = own[i];
    }
  }
}

/* As Filtered.of: `kept` (count, m, m + c, rates), `explained` (c, c, rates), `totals` (count, m, rates). */
void zb_filter(N count, N m, N c, N rates, const D *added, const D *variance, const char *jumps, D *kept,
               D *explained, D *totals, D *work) {
  Series s = {count, m, c, rates, added, variance, jumps};
  N size = count * m * (m + c);
  U *block = (U *)work, *sums = block + size;
  for (N k = 0; k < rates; k += LANES) {
    N n = rates - k;
    filter(&s, 0, k, n, block, sums, totals, sums + c * c);
    for (N i = 0; i < size; ++i) store(kept + i * rates + k, block[i], n);
    for (N i = 0; i < c * c; ++i) store(explained + i * rates + k, sums[i], n);
  }
}

/* a (m, m) becomes its inverse, by sweeps. */
static void inverse(N m, U *a, U *row) {
  for (N k = 0; k < m; ++k) {
    V pivot = a[k * m + k];
    for (N i = 0; i < m; ++i) row[i] = a[i * m + k] / pivot;
    for (N i = 0; i < m; ++i) {
      V column = i == k ? pivot : a[i * m + k];
      for (N j = 0; j < m; ++j) if (i != k && j != k) a[i * m + j] -= column * row[j];
    }
    for (N i = 0; i < m; ++i) a[k * m + i] = a[i * m + k] = row[i];
    a[k * m + k] = -1.0 / pivot;
  }
  for (N i = 0; i < m * m; ++i) a[i] = -a[i];
}

/* As Smoothed.jumps_after of n intervals `after`: `score` and `power` (n, m, rates). */
void zb_jumps(N count, N m, N rates, const D *added, const D *variance, const char *jumps, N n, const N *after,
              D *score, D *power, D *work) {
  Series s = {count, m, 1, rates, added, variance, jumps};
  N w = m + 1, size = count * m * w;
  U *before = (U *)work, *behind = before + size, *whole = behind + size, *own = whole + m * m;
  U *u = own + (m + 2) * w + 1, *v = u + m, *now = v + m;
  for (N k = 0; k < rates; k += LANES) {
    N some = rates - k;
    filter(&s, 0, k, some, before, own, NULL, own + 1);
    filter(&s, 1, k, some, behind, own, NULL, own + 1);
    for (N p = 0; p < n; ++p) {
      N t = after[p] + 1;
      const U *f = before + t * m * w;
      U *b = behind + (count - 1 - t) * m * w;
      const D *of_result = added + t * m * w;
      for (N i = 0; i < m * w; ++i) now[i] = b[i] + of_result[i];
      for (N i = 0; i < m; ++i)
        for (N j = 0; j < m; ++j) whole[i * m + j] = f[i * w + j] + now[i * w + j];
      inverse(m, whole, own);
      for (N i = 0; i < m; ++i) {
        u[i] = v[i] = zb_all(0.0);
        for (N j = 0; j < m; ++j) u[i] += whole[i * m + j] * now[j * w + m], v[i] += whole[i * m + j] * f[j * w + m];
      }
      for (N i = 0; i < m; ++i) {
        V known = zb_all(0.0), moved = zb_all(0.0), back = zb_all(0.0);
        for (N j = 0; j < m; ++j) {
          V own_part = f[i * w] * whole[j];
          for (N q = 1; q < m; ++q) own_part += f[i * w + q] * whole[q * m + j];
          known += own_part * now[i * w + j];
          moved += f[i * w + j] * u[j], back += now[i * w + j] * v[j];
        }
        for (N l = 0; l < LANES && l < some; ++l) {
          N at = (p * m + i) * rates + k + l;
          power[at] = known[l] > 0 ? known[l] : 0.0;
          score[at] = known[l] > 0 ? (moved[l] - back[l]) / sqrt(known[l]) : 0.0;
        }
      }
    }
  }
}
