/* Sparse linear systems. */
#ifndef SMPL_LINEAR_H
#define SMPL_LINEAR_H

#include <stddef.h>

/* A = L U with rows exchanged as the numbers ask for and columns in an order that keeps the factors sparse. */
typedef struct {
    int n;
    const int *columns, *rows, *order;
    int *l_start, *l_row, *u_start, *u_row, *position, *found, *stack, *next, *mark;
    double *l, *u, *x;
    size_t l_room, u_room;
    int pass;
} smpl_lu;

/* For a pattern in compressed columns; 0 where there is no memory. */
int smpl_lu_create(smpl_lu *lu, int n, const int *columns, const int *rows, const int *order);
void smpl_lu_destroy(smpl_lu *lu);

/* 0, or 1 + the column without a pivot, or -1 where there is no memory. */
int smpl_lu_factorise(smpl_lu *lu, const double *values);

/* Solves A x = b in place. */
void smpl_lu_solve(smpl_lu *lu, double *b);

#endif
