#include <math.h>
#define CELLS 425
void residual(const double *restrict y, const double *restrict yp, const double *restrict u, double *restrict f) {
  const double *a = y, *b = y + CELLS, *c = y + 2 * CELLS, *t = y + 3 * CELLS;
  for (int i = 0; i < CELLS; i++) {
    double rate = 3e7 * exp(-6000 / t[i]) * a[i] * b[i];
    double a0 = i ? a[i - 1] : 1, b0 = i ? b[i - 1] : 1.2, c0 = i ? c[i - 1] : 0, t0 = i ? t[i - 1] : 350;
    f[i] = CELLS * (a0 - a[i]) - rate - yp[i];
    f[CELLS + i] = CELLS * (b0 - b[i]) - rate - yp[CELLS + i];
    f[2 * CELLS + i] = CELLS * (c0 - c[i]) + rate - yp[2 * CELLS + i];
    f[3 * CELLS + i] = CELLS * (t0 - t[i]) + 40 * rate - 0.5 * (t[i] - u[0]) - yp[3 * CELLS + i];
  }
}
void jacobian(const double *restrict y, const double *restrict u, double cj, double *restrict values) {
  const double *a = y, *b = y + CELLS, *t = y + 3 * CELLS;
  double *va = values, *vb = values + 5 * CELLS - 1, *vc = vb + 5 * CELLS - 1, *vt = vc + 2 * CELLS - 1;
  for (int i = 0; i < CELLS; i++) {
    double k = 3e7 * exp(-6000 / t[i]), ra = k * b[i], rb = k * a[i], rt = k * a[i] * b[i] * 6000 / (t[i] * t[i]);
    double *p = va + 5 * i;
    *p++ = -CELLS - ra - cj; if (i < CELLS - 1) *p++ = CELLS; *p++ = -ra; *p++ = ra; *p = 40 * ra;
    p = vb + 5 * i;
    *p++ = -rb; *p++ = -CELLS - rb - cj; if (i < CELLS - 1) *p++ = CELLS; *p++ = rb; *p = 40 * rb;
    p = vc + 2 * i;
    *p++ = -CELLS - cj; if (i < CELLS - 1) *p = CELLS;
    p = vt + 5 * i;
    *p++ = -rt; *p++ = -rt; *p++ = rt; *p++ = -CELLS + 40 * rt - 0.5 - cj; if (i < CELLS - 1) *p = CELLS;
  }
  (void)u;
}
