#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <string.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunlinsol/sunlinsol_klu.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunmatrix/sunmatrix_sparse.h>
#include <time.h>
typedef void (*Function)(double t, const double *y, double *out, void *data);
/* Columns of a sparse Jacobian; none of a dense one, whose values are those of all columns. */
typedef struct { Function rates, jacobian; long size, nonzeros; const long *columns, *rows; void *data; } Problem;
static int f(realtype t, N_Vector y, N_Vector out, void *data) {
  Problem *p = data;
  p->rates(t, N_VGetArrayPointer(y), N_VGetArrayPointer(out), p->data);
  return 0;
}
static int jac(realtype t, N_Vector y, N_Vector r, SUNMatrix J, void *data, N_Vector a, N_Vector b, N_Vector c) {
  Problem *p = data;
  if (!p->columns) {
    p->jacobian(t, N_VGetArrayPointer(y), SUNDenseMatrix_Data(J), p->data);
    return 0;
  }
  memcpy(SUNSparseMatrix_IndexPointers(J), p->columns, (p->size + 1) * sizeof(sunindextype));
  memcpy(SUNSparseMatrix_IndexValues(J), p->rows, p->nonzeros * sizeof(sunindextype));
  p->jacobian(t, N_VGetArrayPointer(y), SUNSparseMatrix_Data(J), p->data);
  return 0;
}
/* States at the multiples of `sampling` to `out`, the counts of steps and rates; processor time, or -1 after a failure. */
double solve(Problem *p, const double *start, double *atol, double rtol, double sampling, long samples, double *out, long *counts) {
  SUNContext context;
  SUNContext_Create(NULL, &context);
  N_Vector v = N_VNew_Serial(p->size, context), tolerances = N_VMake_Serial(p->size, atol, context);
  memcpy(N_VGetArrayPointer(v), start, p->size * sizeof(double));
  void *cvode = CVodeCreate(CV_BDF, context);
  CVodeInit(cvode, f, 0, v);
  CVodeSVtolerances(cvode, rtol, tolerances);
  CVodeSetUserData(cvode, p);
  SUNMatrix J = p->columns ? SUNSparseMatrix(p->size, p->size, p->nonzeros, CSC_MAT, context) : SUNDenseMatrix(p->size, p->size, context);
  SUNLinearSolver solver = p->columns ? SUNLinSol_KLU(v, J, context) : SUNLinSol_Dense(v, J, context);
  if (p->columns) SUNLinSol_KLUSetOrdering(solver, 0); /* minimum degree, which fills less than the default here */
  CVodeSetLinearSolver(cvode, solver, J);
  CVodeSetJacFn(cvode, jac);
  CVodeSetMaxNumSteps(cvode, 1000000);
  struct timespec t0, t1;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t0);
  int failed = 0;
  for (long k = 0; k < samples && !failed; k++) {
    double t = 0;
    if (k + 1 == samples) CVodeSetStopTime(cvode, (k + 1) * sampling);
    failed = CVode(cvode, (k + 1) * sampling, v, &t, CV_NORMAL) < 0;
    memcpy(out + k * p->size, N_VGetArrayPointer(v), p->size * sizeof(double));
  }
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t1);
  CVodeGetNumSteps(cvode, counts);
  CVodeGetNumRhsEvals(cvode, counts + 1);
  CVodeFree(&cvode);
  SUNLinSolFree(solver);
  SUNMatDestroy(J);
  N_VDestroy(v);
  N_VDestroy(tolerances);
  SUNContext_Free(&context);
  return failed ? -1 : (t1.tv_sec - t0.tv_sec) + 1e-9 * (t1.tv_nsec - t0.tv_nsec);
}
