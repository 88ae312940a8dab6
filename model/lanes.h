/* Vectors of the compiler, one walker a lane: what the code of every kernel begins with (c_source.py). */
#include <math.h>
#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX__)
#define LANES 4
#else
#define LANES 2
#endif
typedef double V __attribute__((vector_size(LANES * sizeof(double))));
#define LANEWISE(name) static inline V zb_##name(V a) { \
  V r; for (int l = 0; l < LANES; ++l) r[l] = name(a[l]); return r; }
LANEWISE(sqrt) LANEWISE(tan) LANEWISE(exp) LANEWISE(log)
LANEWISE(fabs)
#define OF_TWO(name, value) static inline V zb_##name(V a, V b) { \
  V r; for (int l = 0; l < LANES; ++l) r[l] = (value); return r; }
OF_TWO(lt, a[l] < b[l]) OF_TWO(le, a[l] <= b[l]) OF_TWO(if, a[l] ? b[l] : 0.0)
OF_TWO(fmin, fmin(a[l], b[l])) OF_TWO(fmax, fmax(a[l], b[l])) OF_TWO(atan2, atan2(a[l], b[l]))
static inline V zb_not(V a) { V r; for (int l = 0; l < LANES; ++l) r[l] = !a[l]; return r; }
static inline V zb_all(double a) { return a - (V){0.0}; }
static inline void zb_sincos(V a, V *s, V *c) {
  for (int l = 0; l < LANES; ++l) { (*s)[l] = sin(a[l]); (*c)[l] = cos(a[l]); } }
static inline V zb_load(const double *const *from, long long step, long long at) {
  if (step == 0) return zb_all(from[0][at]);
  V r; for (int l = 0; l < LANES; ++l) r[l] = from[l][at]; return r; }
