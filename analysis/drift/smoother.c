/* The filter and the tests of jumps of smoother.py, which calls it: a rate in each lane. The numbers are those
   of its numpy to rounding. Of symmetric matrices the upper half counts. */
#include <stddef.h>
#define INLINE static inline __attribute__((always_inline))
typedef long long N;
typedef double D;
typedef V U __attribute__((aligned(8)));  /* wherever an array of numbers begins */
typedef struct {
  N count, rates;
  const D *added;      /* (count, m, m + c) */
  const D *per_gap;    /* (count - 1) */
  const D *precision;  /* (m, rates): what a step says in a year */
  const char *jumps;   /* (count - 1, m) */
} Series;
/* f for the usual numbers of offsets, which the compiler then knows. */
#define OF_SIZE(f, ...) do { switch (m) { \
  case 4: f(4, __VA_ARGS__); break; case 5: f(5, __VA_ARGS__); break; \
  case 6: f(6, __VA_ARGS__); break; default: f(m, __VA_ARGS__); } } while (0)
#define UPPER(a, i, j, w) a[(i) < (j) ? (i) * (w) + (j) : (j) * (w) + (i)]

/* Of n lanes. */
INLINE V load(const D *from, N n) {
  if (n >= LANES) return *(const U *)from;
  V r = zb_all(from[0]);
  for (N l = 1; l < n; ++l) r[l] = from[l];
  return r;
}
INLINE void store(D *to, V a, N n) {
  if (n >= LANES) *(U *)to = a;
  else for (N l = 0; l < n; ++l) to[l] = a[l];
}

/* n rates from k on, the results from the first or from the last: `kept` (count, m, m + c) is what is known
   before each, or (1, m, m + c) before the last; `explained` (c, c); `factor` the logarithm of what all are
   eliminated with. work: (m + 1, m + c). */
INLINE void filter(N m, N c, const Series *s, int backward, int all, N k, N n, U *kept, U *explained, V *factor,
                   U *work) {
  N w = m + c;
  U *known = work, *row = known + m * w;
  for (N i = 0; i < m * w; ++i) known[i] = zb_all(0.0);
  for (N i = 0; i < c * c; ++i) explained[i] = zb_all(0.0);
  *factor = zb_all(0.0);
  for (N t = 0; t < s->count; ++t) {
    const D *added = s->added + (backward ? s->count - 1 - t : t) * m * w;
    N interval = backward ? s->count - 2 - t : t, last = t == s->count - 1;
    if (all || last) for (N i = 0; i < m * w; ++i) kept[(all ? t * m * w : 0) + i] = known[i];
    for (N i = 0; i < m * w; ++i) known[i] += added[i];
    V product = zb_all(1.0);
    for (N j = 0; j < m; ++j) {
      V step = zb_all(0.0);
      if (!last && !s->jumps[interval * m + j]) step = s->per_gap[interval] * load(s->precision + j * s->rates + k, n);
      for (N q = 0; q < w; ++q) row[q] = UPPER(known, j, q, w);
      V total = row[j] + step, over = 1.0 / total, share = step * over;
      product *= total;
      for (N a = 0; a < c; ++a)
        for (N b = 0; b < c; ++b) explained[a * c + b] += row[m + a] * over * row[m + b];
      for (N i = 0; i < m; ++i) {
        V part = row[i] * over;
        for (N q = i; q < w; ++q) known[i * w + q] -= part * row[q];
      }
      for (N q = 0; q < w; ++q) UPPER(known, j, q, w) = row[q] * share;
    }
    *factor += zb_log(product);
  }
}

INLINE void filter_all(N m, N c, const Series *s, int all, D *kept, D *explained, D *factor, U *work) {
  N w = m + c, states = all ? s->count : 1;
  U *sums = work + states * m * w;
  for (N k = 0; k < s->rates; k += LANES) {
    N n = s->rates - k;
    V logs;
    filter(m, c, s, 0, all, k, n, work, sums, &logs, sums + c * c);
    for (N t = 0; t < states; ++t)
      for (N i = 0; i < m; ++i)
        for (N q = 0; q < w; ++q)
          store(kept + ((t * m + i) * w + q) * s->rates + k, UPPER((work + t * m * w), i, q, w), n);
    for (N i = 0; i < c * c; ++i) store(explained + i * s->rates + k, sums[i], n);
    store(factor + k, logs, n);
  }
}

/* As Filtered.of: `kept` (count or 1, m, m + c, rates), `explained` (c, c, rates), `factor` (rates). */
void zb_filter(N count, N m, N c, N rates, const D *added, const D *per_gap, const D *precision, const char *jumps,
               N all, D *kept, D *explained, D *factor, D *work) {
  Series s = {count, rates, added, per_gap, precision, jumps};
  if (c == 1) OF_SIZE(filter_all, 1, &s, (int)all, kept, explained, factor, (U *)work);
  else filter_all(m, c, &s, (int)all, kept, explained, factor, (U *)work);
}

INLINE void likelihoods(N m, N arms, Series s, const N *counts, D *result, U *work) {
  N w = m + 1;
  for (N a = 0; a < arms; ++a) {
    s.count = counts[a];
    for (N k = 0; k < s.rates; k += LANES) {
      V factor;
      filter(m, 1, &s, 0, 0, k, s.rates - k, work, work + m * w, &factor, work + m * w + 1);
      store(result + a * s.rates + k, (work[m * w] - factor) / 2.0, s.rates - k);
    }
    s.added += s.count * m * w, s.per_gap += s.count, s.precision += m * s.rates, s.jumps += s.count * m;
  }
}

/* As SeveralSeries.log_likelihood but for the variances of the steps: `result` (arms, rates). */
void zb_likelihoods(N arms, N m, N rates, const N *counts, const D *added, const D *per_gap, const D *precision,
                    const char *jumps, D *result, D *work) {
  Series s = {0, rates, added, per_gap, precision, jumps};
  OF_SIZE(likelihoods, arms, s, counts, result, (U *)work);
}

/* a (m, m) becomes minus its inverse, by sweeps. */
INLINE void sweep(N m, U *a, U *row) {
  for (N k = 0; k < m; ++k) {
    V over = 1.0 / a[k * m + k];
    for (N i = 0; i < m; ++i) row[i] = UPPER(a, i, k, m);
    for (N i = 0; i < m; ++i) {
      V part = row[i] * over;
      for (N j = i; j < m; ++j) if (i != k && j != k) a[i * m + j] -= part * row[j];
    }
    for (N i = 0; i < m; ++i) UPPER(a, i, k, m) = row[i] * over;
    a[k * m + k] = -over;
  }
}

INLINE void jumps_all(N m, const Series *s, N n, const N *after, D *score, D *power, U *work) {
  N w = m + 1, size = s->count * m * w;
  U *before = work, *behind = before + size, *whole = behind + size, *now = whole + m * m, *row = now + m * w;
  U *u = row + (m + 1) * w + 1, *v = u + m;
  V logs;
  for (N k = 0; k < s->rates; k += LANES) {
    N some = s->rates - k;
    filter(m, 1, s, 0, 1, k, some, before, row, &logs, row + 1);
    filter(m, 1, s, 1, 1, k, some, behind, row, &logs, row + 1);
    for (N p = 0; p < n; ++p) {
      N t = after[p] + 1;
      const U *f = before + t * m * w, *b = behind + (s->count - 1 - t) * m * w;
      for (N i = 0; i < m * w; ++i) now[i] = b[i] + s->added[t * m * w + i];
      for (N i = 0; i < m; ++i)
        for (N j = i; j < m; ++j) whole[i * m + j] = f[i * w + j] + now[i * w + j];
      sweep(m, whole, row);
      for (N i = 0; i < m; ++i) {
        u[i] = v[i] = zb_all(0.0);
        for (N j = 0; j < m; ++j)
          u[i] -= UPPER(whole, i, j, m) * now[j * w + m], v[i] -= UPPER(whole, i, j, m) * f[j * w + m];
      }
      for (N i = 0; i < m; ++i) {
        V known = zb_all(0.0), moved = zb_all(0.0), back = zb_all(0.0), scores;
        for (N j = 0; j < m; ++j) {
          V part = zb_all(0.0);
          for (N q = 0; q < m; ++q) part -= UPPER(f, i, q, w) * UPPER(whole, q, j, m);
          known += part * UPPER(now, i, j, w);
          moved += UPPER(f, i, j, w) * u[j], back += UPPER(now, i, j, w) * v[j];
        }
        for (N l = 0; l < LANES; ++l) {
          scores[l] = known[l] > 0 ? (moved[l] - back[l]) / sqrt(known[l]) : 0.0;
          known[l] = known[l] > 0 ? known[l] : 0.0;
        }
        store(score + (p * m + i) * s->rates + k, scores, some);
        store(power + (p * m + i) * s->rates + k, known, some);
      }
    }
  }
}

/* As Smoothed.jumps_after of n intervals `after`: `score` and `power` (n, m, rates). */
void zb_jumps(N count, N m, N rates, const D *added, const D *per_gap, const D *precision, const char *jumps, N n,
              const N *after, D *score, D *power, D *work) {
  Series s = {count, rates, added, per_gap, precision, jumps};
  OF_SIZE(jumps_all, &s, n, after, score, power, (U *)work);
}
