"""The climb of `levenberg_marquardt` from many starts, all steps in one call of C.

For what most runs are: known noise, no stated distances. From Python a step of a few measurements takes ten
times as long as what it computes. Everything else climbs in Python, by the same formulas; up to rounding the
numbers are the same.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ...model.c_source import GridInput, Offsets, columns
from ...model.density import Density
from ...model.kernel import Index, compiled_library
from ...model.robot import Matrix
from .coordinates import SeenCoordinates
from .levenberg_marquardt import DAMPING, NO_LOWER, NO_STEP, NOT_FINITE, TOLERANCE, Minima, Quadratic

_SOURCE = """
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

/* The step h of (C + mu D) h = -g, D the diagonal of C; 0 where C + mu D is not positive. */
static int solved(N f, const D *c, const D *g, D mu, D *l, D *step) {
  for (N i = 0; i < f; ++i)
    for (N j = 0; j <= i; ++j) {
      D own = c[i * f + j];
      if (i == j) own += mu * (own > 1e-300 ? own : 1e-300);
      for (N k = 0; k < j; ++k) own -= l[i * f + k] * l[j * f + k];
      if (i == j && !(own > 0)) return 0;
      l[i * f + j] = i == j ? sqrt(own) : own / l[j * f + j];
    }
  for (N i = 0; i < f; ++i) {
    step[i] = -g[i];
    for (N k = 0; k < i; ++k) step[i] -= l[i * f + k] * step[k];
    step[i] /= l[i * f + i];
  }
  for (N i = f - 1; i >= 0; --i) {
    for (N k = i + 1; k < f; ++k) step[i] -= l[k * f + i] * step[k];
    step[i] /= l[i * f + i];
  }
  return 1;
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
      int whole = solved(f, c, g, mu[r], l, s);
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
"""


class CompiledClimb:
    """The climb of one density's rows."""

    def __init__(self, library: ctypes.CDLL, density: Density, coordinates: SeenCoordinates) -> None:
        self._library = library
        self._kept: list[Any] = [density, coordinates]
        problem = density.problem
        parameters, functions = problem.parameters, problem.functions
        slopes, placed = (functions.kernel(name, compile=True) for name in ("slopes", "placed"))
        sizes = [slopes.function.numel_out(k) for k in range(5)]
        self._size, self._width = density.size, len(parameters)
        nothing = np.zeros((1, self._width))
        (arm,) = columns(nothing, Offsets.of(np.array([parameters.arm.start])))
        targets: list[int] = []
        wide = 0
        for k in range(len(problem.targets)):
            own = parameters.of_shot(k)
            local = np.flatnonzero(parameters.free[own])
            shots = np.flatnonzero(problem.target_index == k)
            inputs = density.inputs(nothing, shots, k)
            targets += [self._call(slopes.address, inputs, nothing, len(shots)), slopes.size_out, sum(sizes)]
            targets += [len(local), self._at(local), self._at(parameters.among_free[own[local]])]
            moved = coordinates.moved(k)
            if moved is None:
                targets += [0] * 8
                continue
            first, moves, column, by, scale = moved
            inputs = [first, arm, GridInput(nothing, 3, first.offsets, 0)]
            targets += [self._call(placed.address, inputs, nothing, 1, seen=True), placed.size_out]
            targets += [parameters.block("target", k).start, len(moves), self._at(moves), self._at(column)]
            targets += [self._at(by), self._at(np.array([scale]))]
            wide += 3 * len(moves)
        self._wide = wide + 3 * len(problem.targets) + slopes.size_out + placed.size_out
        free = np.flatnonzero(parameters.free)
        head = [self._size, self._width, len(problem.targets), self._at(free)]
        head += [self._at(parameters.prior_mean), self._at(parameters.prior_std[free])]
        self._head, self._targets = self._at(np.array(head)), self._at(np.array(targets))

    def _at(self, values: Matrix | Index) -> int:
        """The address of an array that is kept."""
        self._kept.append(np.ascontiguousarray(values))
        return int(self._kept[-1].ctypes.data)

    def _call(
        self, function: int, inputs: Sequence[GridInput], x: Matrix, inner: int, *, seen: bool = False
    ) -> int:
        """The address of what C takes as a kernel's call."""
        numbers = [len(inputs), inner, function]
        for k, given in enumerate(inputs):
            self._kept.append(given)
            by_set = 3 if given.step else 0
            kind = 2 if seen and k == 2 else 1 if given.values is x else by_set
            numbers += [kind, given.address, given.step, given.offsets.address]
        return self._at(np.array(numbers))

    def slopes(self, v: Matrix, of: Index, *, with_information: bool = True) -> Quadratic:
        """Minus the log-posterior at v (W, f) of data sets `of` (W,), its gradient and information in v;
        where that was not asked for, of no rows."""
        v, of, rows = np.ascontiguousarray(v), np.ascontiguousarray(of), len(v)
        found = self._empty(rows, rows if with_information else 0)
        work = np.empty(rows * (self._wide + self._width))
        self._library.zb_slopes(
            self._head, self._targets, rows, v.ctypes.data, of.ctypes.data, work.ctypes.data,
            found.cost.ctypes.data, found.gradient.ctypes.data,
            found.curvature.ctypes.data if with_information else None,
            work.ctypes.data + 8 * rows * self._width,
        )  # fmt: skip
        return found

    def up(self, v: Matrix, of: Index, most: int, absolute: float, longest: Matrix) -> Minima:
        """As `levenberg_marquardt`."""
        v, of, rows = np.array(v, order="C"), np.ascontiguousarray(of), len(v)
        found = self._empty(rows, rows)
        iterations, ended = np.empty((2, rows), dtype=np.int64)
        self._library.zb_climb(
            self._head, self._targets, rows, v.ctypes.data, of.ctypes.data, most, DAMPING, TOLERANCE,
            absolute, longest.ctypes.data, self._wide, *(part.ctypes.data for part in found),
            iterations.ctypes.data, ended.ctypes.data,
        )  # fmt: skip
        if rows and ended[0] < 0:
            raise MemoryError
        reasons = (f"no convergence in {most} iterations", NO_LOWER, NO_STEP, NOT_FINITE)
        return Minima(v, *found, iterations, ended == 1, [reasons[k] for k in ended.tolist()])

    def _empty(self, rows: int, informations: int) -> Quadratic:
        size = self._size
        return Quadratic(np.empty(rows), np.empty((rows, size)), np.empty((informations, size, size)))


def compiled_climb(
    density: Density, coordinates: SeenCoordinates, *, compile: bool | None = None
) -> CompiledClimb | None:
    """That of a density; None where Python is to climb. It serves as soon as the kernel of the slopes is
    compiled, `compile` being as for that."""
    problem = density.problem
    plain = problem.noise.known and not problem.distances and problem.functions.log_det == "none"
    if not (plain and density.size and problem.functions.kernel("slopes", compile=compile).compiled):
        return None
    return _made(density, coordinates)


@lru_cache(maxsize=8)
def _made(density: Density, coordinates: SeenCoordinates) -> CompiledClimb | None:
    library = _library()
    kernels = [density.problem.functions.kernel(name, compile=True) for name in ("slopes", "placed")]
    ready = library is not None and all(kernel.compiled for kernel in kernels)
    return CompiledClimb(library, density, coordinates) if library is not None and ready else None


@cache
def _library() -> ctypes.CDLL | None:
    pointer, whole, number = ctypes.c_void_p, ctypes.c_longlong, ctypes.c_double
    slopes = [pointer, pointer, whole, *([pointer] * 7)]
    climb = [pointer, pointer, whole, pointer, pointer, whole, number, number, number, pointer, whole]
    functions = {"zb_slopes": slopes, "zb_climb": [*climb, *([pointer] * 5)]}
    return compiled_library("climb", lambda: _SOURCE, functions, make=True)
