#include <math.h>
typedef struct { double x0, ea, s0, l, dt, sd0, e0, ks; } Rates;
static Rates rates(double celsius) {
  double t = 1 / (celsius + 273.15);
  Rates r = { exp(108.31 - 31934.09 * t), exp(89.92 - 26589.0 * t), exp(-41.92 + 11654.64 * t), exp(30.72 - 9501.54 * t),
              exp(130.16 - 38313.0 * t), exp(33.82 - 10033.28 * t), exp(3.27 - 1267.24 * t), exp(-119.63 + 34203.95 * t) };
  return r;
}
/* The temperature stands still within a step: its functions are worked out once, as the compiled model does. */
static Rates r;
void prepare(const double *u) { r = rates(u[0]); }
void residual(const double *restrict y, const double *restrict yp, const double *restrict u, double *restrict f) {
  double inhibited = 65 + y[4], grown = r.x0 * y[3] / inhibited * y[0], died = r.dt * y[0], woken = r.l * y[1];
  double monod = r.ks + y[3];
  f[0] = grown - died + woken - yp[0];
  f[1] = -woken - yp[1];
  f[2] = died - r.sd0 * 65 / inhibited * y[2] - yp[2];
  f[3] = -r.s0 * y[3] / monod * y[0] - yp[3];
  f[4] = (1 - y[4] / 65) * r.e0 * y[3] / monod * y[0] - yp[4];
  f[5] = 0.000127672 * y[3] * y[0] - 0.00113864 * y[5] * y[4] - yp[5];
  f[6] = r.ea * grown - yp[6];
  (void)u;
}
void jacobian(const double *restrict y, const double *restrict u, double cj, double *restrict j) {
  double inhibited = 65 + y[4], mu = r.x0 * y[3] / inhibited, monod = r.ks + y[3], share = y[3] / monod, slope = r.ks / (monod * monod);
  double by_sugar = r.x0 / inhibited * y[0], by_ethanol = -mu * y[0] / inhibited, fall = 1 - y[4] / 65;
  double *a = j, *l = j + 7, *d = j + 14, *s = j + 21, *e = j + 28, *dy = j + 35, *ea = j + 42;
  a[0] = mu - r.dt - cj; a[1] = 0; a[2] = r.dt; a[3] = -r.s0 * share; a[4] = fall * r.e0 * share; a[5] = 0.000127672 * y[3]; a[6] = r.ea * mu;
  l[0] = r.l; l[1] = -r.l - cj; l[2] = l[3] = l[4] = l[5] = l[6] = 0;
  d[0] = d[1] = 0; d[2] = -r.sd0 * 65 / inhibited - cj; d[3] = d[4] = d[5] = d[6] = 0;
  s[0] = by_sugar; s[1] = s[2] = 0; s[3] = -r.s0 * slope * y[0] - cj; s[4] = fall * r.e0 * slope * y[0]; s[5] = 0.000127672 * y[0]; s[6] = r.ea * by_sugar;
  e[0] = by_ethanol; e[1] = 0; e[2] = r.sd0 * 65 / (inhibited * inhibited) * y[2]; e[3] = 0;
  e[4] = -r.e0 * share * y[0] / 65 - cj; e[5] = -0.00113864 * y[5]; e[6] = r.ea * by_ethanol;
  dy[0] = dy[1] = dy[2] = dy[3] = dy[4] = dy[6] = 0; dy[5] = -0.00113864 * y[4] - cj;
  ea[0] = ea[1] = ea[2] = ea[3] = ea[4] = ea[5] = 0; ea[6] = -cj;
  (void)u;
}
