#include <time.h>
static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}
void residual(const double *restrict y, const double *restrict yp, const double *restrict u, double *restrict f);
void jacobian(const double *restrict y, const double *restrict u, double cj, double *restrict values);
double least_time(int which, const double *y, const double *yp, const double *u, double *out) {
  double least = 1e9;
  long count = 3;
  for (int batch = 0; batch < 52; batch++) {
    double begin = now();
    for (long i = 0; i < count; i++) {
      if (which == 0) residual(y, yp, u, out); else jacobian(y, u, 1.0, out);
      __asm__ volatile("" : : "r"(y), "r"(out) : "memory");
    }
    double each = (now() - begin) / count;
    if (batch > 0 && each < least) least = each;
    if (batch == 0) { count = (long)(1e-3 / (each + 1e-9)); if (count < 3) count = 3; if (count > 100000) count = 100000; }
  }
  return least;
}
