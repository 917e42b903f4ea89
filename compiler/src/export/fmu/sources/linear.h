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
    int pass;
} smpl_lu;

/* Lays out factors of a pattern in compressed columns in a block of numbers, which begins with `mark` at zero; without a block it is
 * measured only. `l_room` and `u_room` are the most entries that the factors can have. Returns the length of the block. */
size_t smpl_lu_place(
    smpl_lu *lu, int n, const int *columns, const int *rows, const int *order, size_t l_room, size_t u_room, double *block);

/* 0, or 1 + the column without a pivot. */
int smpl_lu_factorise(smpl_lu *lu, const double *values);

/* Solves A x = b in place. */
void smpl_lu_solve(smpl_lu *lu, double *b);

#endif
