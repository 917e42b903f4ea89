#include <math.h>
void residual(const double *restrict y, const double *restrict yp, const double *restrict u, double *restrict f) {
  const double area = 3.141592653589793 * 0.219 * 0.219, heat = 1000 * 0.239;
  double dilution = 0.1 / (area * y[2] + 1e-8), rate = 7.2e10 * exp(-8750 / (y[1] + 273.15)) * y[0];
  f[0] = dilution * (1.0 - y[0]) - rate - yp[0];
  f[1] = dilution * (76.85 - y[1]) + 5e4 / heat * rate + 2 * 54.94 / (0.219 * heat) * (u[0] - y[1]) - yp[1];
  f[2] = (0.1 - u[1]) / area - yp[2];
}
void jacobian(const double *restrict y, const double *restrict u, double cj, double *restrict j) {
  const double area = 3.141592653589793 * 0.219 * 0.219, heat = 1000 * 0.239;
  double volume = area * y[2] + 1e-8, dilution = 0.1 / volume, slope = -dilution / volume * area;
  double kelvin = y[1] + 273.15, k = 7.2e10 * exp(-8750 / kelvin), rate = k * y[0], warm = rate * 8750 / (kelvin * kelvin);
  j[0] = -dilution - k - cj;       j[3] = -warm;                                                          j[6] = slope * (1.0 - y[0]);
  j[1] = 5e4 / heat * k;           j[4] = -dilution + 5e4 / heat * warm - 2 * 54.94 / (0.219 * heat) - cj; j[7] = slope * (76.85 - y[1]);
  j[2] = 0;                        j[5] = 0;                                                              j[8] = -cj;
  (void)u;
}
