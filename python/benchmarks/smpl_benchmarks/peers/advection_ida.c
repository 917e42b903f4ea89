#include <ida/ida.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_klu.h>
#include <sunmatrix/sunmatrix_sparse.h>
#include <time.h>
void residual(const double *restrict y, const double *restrict yp, const double *restrict u, double *restrict f);
void jacobian(const double *restrict y, const double *restrict u, double cj, double *restrict values);
static int f(realtype t, N_Vector y, N_Vector yp, N_Vector out, void *u) {
  residual(N_VGetArrayPointer(y), N_VGetArrayPointer(yp), u, N_VGetArrayPointer(out));
  return 0;
}
static int pattern(sunindextype *pointers, sunindextype *rows) {
  int k = 0;
  for (int s = 0; s < 4; s++) for (int i = 0; i < CELLS; i++) {
    pointers[s * CELLS + i] = k;
    for (int r = 0; r < 4; r++) {
      if (s == 2 && r != 2) continue;
      rows[k++] = r * CELLS + i;
      if (r == s && i < CELLS - 1) rows[k++] = r * CELLS + i + 1;
    }
  }
  return k;
}
static int jac(realtype t, realtype cj, N_Vector y, N_Vector yp, N_Vector r, SUNMatrix J, void *u, N_Vector a, N_Vector b, N_Vector c) {
  sunindextype *pointers = SUNSparseMatrix_IndexPointers(J);
  pointers[4 * CELLS] = pattern(pointers, SUNSparseMatrix_IndexValues(J));
  jacobian(N_VGetArrayPointer(y), u, cj, SUNSparseMatrix_Data(J));
  return 0;
}
double solve(double *y, int steps, double length, const double *jackets, double tolerance, long *counts) {
  struct timespec t0, t1;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t0);
  SUNContext context;
  SUNContext_Create(NULL, &context);
  N_Vector v = N_VMake_Serial(4 * CELLS, y, context), vp = N_VNew_Serial(4 * CELLS, context);
  N_VConst(0, vp);
  double u[1] = { jackets[0] };
  void *ida = IDACreate(context);
  IDAInit(ida, f, 0, v, vp);
  IDASStolerances(ida, tolerance, tolerance);
  IDASetUserData(ida, u);
  SUNMatrix J = SUNSparseMatrix(4 * CELLS, 4 * CELLS, 17 * CELLS - 4, CSC_MAT, context);
  SUNLinearSolver klu = SUNLinSol_KLU(v, J, context);
  IDASetLinearSolver(ida, klu, J);
  IDASetJacFn(ida, jac);
  IDASetMaxNumSteps(ida, 100000);
  int failed = 0;
  for (int k = 0; k < steps && !failed; k++) {
    double t = 0;
    u[0] = jackets[k];
    double *rates = N_VGetArrayPointer(vp);
    static const double zero[4 * CELLS];
    residual(y, zero, u, rates);
    IDAReInit(ida, 0, v, vp);
    IDASetStopTime(ida, length);
    failed = IDASolve(ida, length, &t, v, vp, IDA_NORMAL) < 0;
    long steps_made, residuals;
    IDAGetNumSteps(ida, &steps_made);
    IDAGetNumResEvals(ida, &residuals);
    counts[0] += steps_made;
    counts[1] += residuals;
  }
  IDAFree(&ida);
  SUNLinSolFree(klu);
  SUNMatDestroy(J);
  N_VDestroy(v);
  N_VDestroy(vp);
  SUNContext_Free(&context);
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t1);
  return failed ? -1 : (t1.tv_sec - t0.tv_sec) + 1e-9 * (t1.tv_nsec - t0.tv_nsec);
}
