/* The climb: Levenberg and Marquardt's steps, Newton's, and the covariance at the top (climb.py calls it). */
#include <math.h>
#include <stdlib.h>
#include <string.h>
typedef long long N;
typedef double D;
typedef void Sum(const D **, const N *, const N **, const N **, N, N, D *);

/* A kernel's call: inputs, inner, function, then for each input what it is (0 shared, 1 in x, 2 in y, 3 by
   data set), values, step and offsets. */
static void sum(const N *t, N rows, const D *x, const D *y, const N *of, D *out) {
  const D *values[9]; const N *row[9], *offset[9]; N step[9];
  for (N i = 0; i < t[0]; ++i) {
    const N *own = t + 3 + 4 * i;
    values[i] = own[0] == 1 ? x : own[0] == 2 ? y : (const D *)own[1];
    row[i] = own[0] == 3 ? of : NULL;
    step[i] = own[2];
    offset[i] = (const N *)own[3];
  }
  ((Sum *)t[2])(values, step, row, offset, rows, t[1], out);
}

typedef struct { N f, p, targets; const N *free; const D *mean, *scale; } Head;
typedef struct {
  const N *slopes; N columns, gram; N size; const N *local, *at;
  const N *placed; N wide, place, moved; const N *moves, *column; const D *by, *scale;
} Target;

/* Minus the log-posterior, its gradient (f) and, unless NULL, information (f, f) in v, and x, of each row. */
void zb_slopes(const Head *h, const Target *targets, N rows, const D *v, const N *of, D *x, D *value,
                   D *gradient, D *information, D *work) {
  N f = h->f, p = h->p;
  D *y = work, *placed = y + 3 * rows * h->targets, *out;
  for (N r = 0; r < rows; ++r) {
    memcpy(x + r * p, h->mean, p * sizeof(D));
    for (N i = 0; i < f; ++i) x[r * p + h->free[i]] += h->scale[i] * v[r * f + i];
  }
  memset(value, 0, rows * sizeof(D));
  memset(gradient, 0, rows * f * sizeof(D));
  if (information) memset(information, 0, rows * f * f * sizeof(D));
  for (N k = 0; k < h->targets; ++k) {
    const Target *t = targets + k;
    D *seen = y + 3 * rows * k;
    for (N r = 0; r < rows && t->moved; ++r)
      for (N c = 0; c < 3; ++c) seen[3 * r + c] = v[r * f + t->moves[t->moved - 3 + c]] * *t->scale;
    if (t->moved) {
      N wide = t->wide;
      sum(t->placed, rows, x, seen, of, placed);
      for (N r = 0; r < rows; ++r) memcpy(x + r * p + t->place, placed + r * wide, 3 * sizeof(D));
      for (N r = 0; r < rows; ++r)  /* how the target moves, kept where the next kernel does not write */
        for (N j = 0; j < t->moved; ++j) {
          const D *own = placed + r * wide + 3 + 3 * t->column[j];
          for (N c = 0; c < 3; ++c) placed[(r * t->moved + j) * 3 + c] = own[c] * t->by[3 * j + c];
        }
    }
    out = placed + rows * 3 * t->moved;
    N measured = t->slopes[1] > 0;  /* else the kernel would read what is not there */
    if (measured) sum(t->slopes, rows, x, NULL, of, out);
    for (N r = 0; r < rows && measured; ++r) {
      const D *own = out + r * t->columns;
      D *g = gradient + r * f, *w = information ? information + r * f * f : NULL;
      value[r] += own[0] / 2;
      for (N i = 0; i < t->size; ++i) {
        N a = t->at[i], la = t->local[i];
        g[a] += own[2 + la] * h->scale[a] / 2;
        for (N j = 0; w && j < t->size; ++j) {
          N b = t->at[j], lb = t->local[j], high = la > lb ? la : lb;
          w[a * f + b] += own[t->gram + high * (high + 1) / 2 + la + lb - high] * h->scale[a] * h->scale[b];
        }
      }
    }
    placed += rows * 3 * t->moved;
  }
  placed = y + 3 * rows * h->targets;
  for (N r = 0; r < rows; ++r)
    for (N i = 0; i < f; ++i) {
      D z = (x[r * p + h->free[i]] - h->mean[h->free[i]]) / h->scale[i];
      value[r] += z * z / 2;
      gradient[r * f + i] += z;
      if (information) information[(r * f + i) * f + i] += 1.0;
    }
  for (N k = 0; k < h->targets; ++k) {
    const Target *t = targets + k;
    N m = t->moved;
    for (N r = 0; r < rows && m; ++r) {
      const D *by = placed + r * 3 * m;
      N own = t->moves[m - 3];
      /* The gradient, then rows and columns of the information. */
      for (N i = -1; i < (information ? 2 * f : 0); ++i) {
        D *w = i < 0 ? gradient + r * f : information + r * f * f + (i < f ? i * f : i - f);
        N stride = i < f ? 1 : f;
        D z[3] = {w[own * stride], w[(own + 1) * stride], w[(own + 2) * stride]};
        for (N c = 0; c < 3; ++c) w[(own + c) * stride] = 0.0;
        for (N j = 0; j < m; ++j)
          w[t->moves[j] * stride] += z[0] * by[3 * j] + z[1] * by[3 * j + 1] + z[2] * by[3 * j + 2];
      }
    }
    placed += rows * 3 * m;
  }
  for (N r = 0; r < rows; ++r) if (!isfinite(value[r])) value[r] = INFINITY;
}

/* The lower factor l of c with (1 + mu) times its diagonal, less `less`; 0 where that is not positive. */
static int factor(N f, const D *c, D mu, D less, D *l) {
  for (N i = 0; i < f; ++i)
    for (N j = 0; j <= i; ++j) {
      D own = c[i * f + j];
      if (i == j) own += mu * (own > 1e-300 ? own : 1e-300) - less;
      for (N k = 0; k < j; ++k) own -= l[i * f + k] * l[j * f + k];
      if (i == j && !(own > 0)) return 0;
      l[i * f + j] = i == j ? sqrt(own) : own / l[j * f + j];
    }
  return 1;
}

/* The step of l l' step = -g. */
static void solved(N f, const D *l, const D *g, D *step) {
  for (N i = 0; i < f; ++i) {
    step[i] = -g[i];
    for (N k = 0; k < i; ++k) step[i] -= l[i * f + k] * step[k];
    step[i] /= l[i * f + i];
  }
  for (N i = f - 1; i >= 0; --i) {
    for (N k = i + 1; k < f; ++k) step[i] -= l[k * f + i] * step[k];
    step[i] /= l[i * f + i];
  }
}

/* From v (rows, f) up; what is found takes its place. `ended`: 0 at `most`, 1 no lower, 2 no step, 3 not
   finite, -1 (of the first) no memory. */
void zb_climb(const Head *h, const Target *targets, N rows, D *v, const N *of, N most, D damping,
             D tolerance, D absolute, const D *longest, N wide, D *value, D *gradient, D *information,
             N *iterations, N *ended) {
  N f = h->f, ff = f * f, p = h->p, left = 0;
  D *all = malloc((rows * (p + 3 * f + ff + 4 + wide) + ff) * sizeof(D));
  N *active = malloc(2 * rows * sizeof(N));
  if (!all || !active) { free(all); free(active); ended[0] = -1; return; }
  D *x = all, *trial = x + rows * p, *step = trial + rows * f, *promised = step + rows * f;
  D *next = promised + rows, *next_g = next + rows, *next_w = next_g + rows * f, *mu = next_w + rows * ff;
  D *nu = mu + rows, *l = nu + rows, *work = l + ff;
  N *set = active + rows;
  zb_slopes(h, targets, rows, v, of, x, value, gradient, information, work);
  for (N r = 0; r < rows; ++r) {
    mu[r] = damping, nu[r] = 2.0, ended[r] = isfinite(value[r]) ? 0 : 3;
    iterations[r] = ended[r] ? 0 : most;
    if (!ended[r]) active[left++] = r;
  }
  for (N turn = 0; turn < most && left; ++turn) {
    N tried = 0;
    for (N q = 0; q < left; ++q) {
      N r = active[q];
      const D *c = information + r * ff, *g = gradient + r * f;
      D *s = step + q * f, most_of = 1.0, gain = 0.0;
      int whole = factor(f, c, mu[r], 0.0, l);
      if (whole) solved(f, l, g, s);
      for (N i = 0; i < f && whole; ++i) most_of = fmax(most_of, fabs(s[i] / longest[i]));
      for (N i = 0; i < f && whole; ++i) s[i] /= most_of;
      for (N i = 0; i < f && whole; ++i) {
        D bent = 0.0;
        for (N j = 0; j < f; ++j) bent += c[i * f + j] * s[j];
        gain -= s[i] * (g[i] + bent / 2);
      }
      if (!whole) gain = NAN;
      if (gain <= fmax(tolerance * fabs(value[r]), absolute)) ended[r] = 1;
      else if (!isfinite(mu[r])) ended[r] = 2;
      if (ended[r]) { iterations[r] = turn; continue; }
      for (N i = 0; i < f; ++i) trial[tried * f + i] = whole ? v[r * f + i] + s[i] : NAN;
      promised[tried] = gain, set[tried] = of[r], active[tried++] = r;
    }
    left = tried;
    if (left) zb_slopes(h, targets, left, trial, set, x, next, next_g, next_w, work);
    for (N q = 0; q < left; ++q) {
      N r = active[q];
      D gain = (value[r] - next[q]) / promised[q];
      if (gain > 0) {
        D easier = 1 - pow(2 * fmin(gain, 2.0) - 1, 3);
        mu[r] *= fmax(1.0 / 3, easier), nu[r] = 2.0, value[r] = next[q];
        memcpy(v + r * f, trial + q * f, f * sizeof(D));
        memcpy(gradient + r * f, next_g + q * f, f * sizeof(D));
        memcpy(information + r * ff, next_w + q * ff, ff * sizeof(D));
      } else mu[r] *= nu[r], nu[r] *= 2;
    }
  }
  free(all);
  free(active);
}

/* l of a lower triangle, inverted in its place, with 0 above. */
static void inverted(N f, D *l) {
  for (N i = 0; i < f; ++i) {
    D own = 1 / l[i * f + i];
    for (N j = 0; j < i; ++j) {
      D sum = 0.0;
      for (N k = j; k < i; ++k) sum += l[i * f + k] * l[k * f + j];
      l[i * f + j] = -own * sum;
    }
    l[i * f + i] = own;
    for (N j = i + 1; j < f; ++j) l[i * f + j] = 0.0;
  }
}

/* to = whiten g, and its length. */
static D whitened(N f, const D *whiten, const D *g, D *to) {
  D square = 0.0;
  for (N i = 0; i < f; ++i) {
    to[i] = 0.0;
    for (N k = 0; k <= i; ++k) to[i] += whiten[i * f + k] * g[k];
    square += to[i] * to[i];
  }
  return sqrt(square);
}

/* How many rows `curved` takes at once: the points of less would not fill the kernels' lanes. */
static N together(N f) { return f < 32 ? 64 / (2 * f) : 1; }

/* The curvature (f, f) of minus the log-posterior along the rows of `whiten`, of these rows. */
static void curved(const Head *h, const Target *targets, N count, const N *rows, const D *v, const N *of,
                   const D *whiten, D difference, D *curvature, N *sets, D *work) {
  N f = h->f, ff = f * f, p = h->p, some = together(f), points = 2 * f * some;
  D *at = work, *x = at + points * f, *value = x + points * p, *gradient = value + points;
  D *deep = gradient + points * f;
  for (N first = 0; first < count; first += some) {
    N own = count - first < some ? count - first : some;
    for (N k = 0; k < 2 * f * own; ++k) {
      N r = rows[first + k / (2 * f)], j = k % f;
      D by = k / f % 2 ? difference : -difference;
      for (N c = 0; c < f; ++c) at[k * f + c] = v[r * f + c] + by * whiten[r * ff + j * f + c];
      sets[k] = of[r];
    }
    zb_slopes(h, targets, 2 * f * own, at, sets, x, value, gradient, NULL, deep);
    for (N q = 0; q < own; ++q) {
      N r = rows[first + q];
      const D *down = gradient + 2 * q * ff, *up = down + ff, *w = whiten + r * ff;
      D *to = curvature + r * ff;
      for (N j = 0; j < f; ++j)
        for (N k = 0; k < f; ++k) {
          D sum = 0.0;
          for (N c = 0; c <= k; ++c) sum += (up[j * f + c] - down[j * f + c]) * w[k * f + c];
          to[j * f + k] = sum / (2 * difference);
        }
      for (N j = 0; j < f; ++j)
        for (N k = 0; k < j; ++k) to[j * f + k] = to[k * f + j] = (to[j * f + k] + to[k * f + j]) / 2;
    }
  }
}

static const D ROUNDING = 1e3;  /* ends: below so many a step that does not lead up is rounding's */

/* Newton's steps from v (rows, f), whitened by the information, and the covariance where they end; `whole`
   says for which rows: not where a step is to be shortened or a curvature is not above `flat`. */
void zb_polish(const Head *h, const Target *targets, N rows, D *v, const N *of, N most, D end, D flat,
               D difference, D still, N wide, D *value, const D *start, const D *information, D *size,
               D *covariance, N *iterations, N *whole) {
  N f = h->f, ff = f * f, p = h->p, left = 0, points = 2 * f * together(f);
  N deep = rows > points ? rows : points;
  D *all = malloc((rows * (2 * ff + 3 * f + 2) + 2 * ff + deep * (2 * f + p + 1 + wide)) * sizeof(D));
  N *active = malloc((3 * rows + points) * sizeof(N));
  if (!all || !active) { free(all); free(active); if (rows) whole[0] = -1; return; }
  D *whiten = all, *curvature = whiten + rows * ff, *slope = curvature + rows * ff;
  D *trial = slope + rows * f, *way = trial + rows * f, *length = way + rows, *step = length + rows;
  D *l = step + rows * f, *m = l + ff, *work = m + ff;
  D *x = work, *next = x + rows * p, *next_g = next + rows, *sums = next_g + rows * f;
  N *again = active + rows, *set = again + rows, *sets = set + rows;
  for (N r = 0; r < rows; ++r) {
    D *w = whiten + r * ff;
    way[r] = 0.0;
    whole[r] = isfinite(value[r]) && factor(f, information + r * ff, 0.0, 0.0, w);
    if (!whole[r]) continue;
    inverted(f, w);
    size[r] = whitened(f, w, start + r * f, slope + r * f);
    active[left++] = r;
  }
  curved(h, targets, left, active, v, of, whiten, difference, curvature, sets, work);
  for (N turn = 0; turn < most && left; ++turn) {
    N tried = 0, kept = 0, stale = 0;
    for (N q = 0; q < left; ++q) {
      N r = active[q];
      const D *c = curvature + r * ff, *w = whiten + r * ff;
      D *s = step + tried * f, *to = trial + tried * f, square = 0.0;
      if (size[r] < end) continue;
      whole[r] = factor(f, c, 0.0, flat, l) && factor(f, c, 0.0, 0.0, l);
      if (!whole[r]) continue;
      solved(f, l, slope + r * f, s);
      memcpy(to, v + r * f, f * sizeof(D));
      for (N k = 0; k < f; ++k) {
        square += s[k] * s[k];
        for (N c = 0; c <= k; ++c) to[c] += w[k * f + c] * s[k];
      }
      length[tried] = sqrt(square), set[tried] = of[r], active[tried++] = r;
    }
    left = tried;
    if (left) zb_slopes(h, targets, left, trial, set, x, next, next_g, NULL, sums);
    for (N q = 0; q < left; ++q) {
      N r = active[q];
      D before = size[r], after = whitened(f, whiten + r * ff, next_g + q * f, l);
      /* Near the top the values differ by rounding only: there the slope decides. */
      whole[r] = next[q] < value[r] || (after < 0.5 * before && before < 2e-3);
      if (!whole[r]) {  /* at the top but for rounding, or a step is to be shortened */
        whole[r] = before < ROUNDING * end;
        continue;
      }
      memcpy(v + r * f, trial + q * f, f * sizeof(D));
      memcpy(slope + r * f, l, f * sizeof(D));
      value[r] = next[q], size[r] = after, way[r] += length[q], ++iterations[r];
      if (after > 0.1 * before) way[r] = 0.0, again[stale++] = r;
      active[kept++] = r;
    }
    left = kept;
    curved(h, targets, stale, again, v, of, whiten, difference, curvature, sets, work);
  }
  left = 0;
  for (N r = 0; r < rows; ++r) if (whole[r] && way[r] > still) again[left++] = r;
  curved(h, targets, left, again, v, of, whiten, difference, curvature, sets, work);
  for (N r = 0; r < rows; ++r) {
    const D *c = curvature + r * ff, *w = whiten + r * ff;
    D *to = covariance + r * ff;
    whole[r] = whole[r] && factor(f, c, 0.0, flat, l) && factor(f, c, 0.0, 0.0, l);
    if (!whole[r]) continue;
    inverted(f, l);
    for (N i = 0; i < f; ++i)  /* m = l^-1 whiten, a lower triangle */
      for (N j = 0; j <= i; ++j) {
        m[i * f + j] = 0.0;
        for (N k = j; k <= i; ++k) m[i * f + j] += l[i * f + k] * w[k * f + j];
      }
    for (N i = 0; i < f; ++i)
      for (N j = 0; j <= i; ++j) {
        D sum = 0.0;
        for (N k = i; k < f; ++k) sum += m[k * f + i] * m[k * f + j];
        to[i * f + j] = to[j * f + i] = sum;
      }
  }
  free(all);
  free(active);
}
