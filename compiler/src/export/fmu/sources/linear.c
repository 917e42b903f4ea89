/* Left-looking sparse LU (J. R. Gilbert and T. Peierls, Sparse partial pivoting in time proportional to arithmetic operations, SIAM
 * J. Sci. Stat. Comput. 9 (1988) 862): the non-zeros of each column are found by a search in the graph of L before it is computed. */
#include "linear.h"

#include <math.h>
#include <string.h>

/* The diagonal is taken as the pivot unless it is smaller than this part of the largest entry. */
#define DIAGONAL 0.1

/* A part of the block for so many integers. */
static int *integers(double *block, size_t *used, size_t length)
{
    int *part = block ? (int *)(block + *used) : NULL;
    *used += (length * sizeof(int) + sizeof(double) - 1) / sizeof(double);
    return part;
}

static double *numbers(double *block, size_t *used, size_t length)
{
    double *part = block ? block + *used : NULL;
    *used += length;
    return part;
}

size_t smpl_lu_place(
    smpl_lu *lu, int n, const int *columns, const int *rows, const int *order, size_t l_room, size_t u_room, double *block)
{
    const size_t size = (size_t)n;
    size_t used = 0;
    lu->n = n;
    lu->columns = columns;
    lu->rows = rows;
    lu->order = order;
    lu->pass = 0;
    lu->mark = integers(block, &used, size);
    lu->l_start = integers(block, &used, size + 1);
    lu->u_start = integers(block, &used, size + 1);
    lu->position = integers(block, &used, size);
    lu->found = integers(block, &used, size);
    lu->stack = integers(block, &used, size);
    lu->next = integers(block, &used, size);
    lu->l_row = integers(block, &used, l_room);
    lu->u_row = integers(block, &used, u_room);
    lu->l = numbers(block, &used, l_room);
    lu->u = numbers(block, &used, u_room);
    lu->x = numbers(block, &used, size);
    return used;
}

/* Rows that a row leads to in the graph of L, before those that lead to them; fills `found` from `top` down. */
static int search(smpl_lu *lu, int row, int top)
{
    int depth = 0;
    lu->stack[0] = row;
    lu->mark[row] = lu->pass;
    lu->next[0] = lu->position[row] < 0 ? 0 : lu->l_start[lu->position[row]] + 1;
    while (depth >= 0) {
        const int here = lu->stack[depth], column = lu->position[here];
        const int end = column < 0 ? 0 : lu->l_start[column + 1];
        int deeper = 0;
        while (lu->next[depth] < end && !deeper) {
            const int other = lu->l_row[lu->next[depth]++];
            if (lu->mark[other] != lu->pass) {
                lu->mark[other] = lu->pass;
                deeper = 1;
                ++depth;
                lu->stack[depth] = other;
                lu->next[depth] = lu->position[other] < 0 ? 0 : lu->l_start[lu->position[other]] + 1;
            }
        }
        if (!deeper) {
            lu->found[--top] = here;
            --depth;
        }
    }
    return top;
}

/* Solves with the columns of L that are there for a column of A; where its non-zeros begin in `found`. */
static int column_of(smpl_lu *lu, int column, const double *values)
{
    int top = lu->n;
    ++lu->pass;
    for (int p = lu->columns[column]; p < lu->columns[column + 1]; ++p) {
        if (lu->mark[lu->rows[p]] != lu->pass) top = search(lu, lu->rows[p], top);
    }
    for (int p = top; p < lu->n; ++p) lu->x[lu->found[p]] = 0.0;
    for (int p = lu->columns[column]; p < lu->columns[column + 1]; ++p) lu->x[lu->rows[p]] = values[p];
    for (int p = top; p < lu->n; ++p) {
        const int row = lu->found[p], k = lu->position[row];
        if (k >= 0) {
            const double x = lu->x[row];
            for (int q = lu->l_start[k] + 1; q < lu->l_start[k + 1]; ++q) lu->x[lu->l_row[q]] -= lu->l[q] * x;
        }
    }
    return top;
}

int smpl_lu_factorise(smpl_lu *lu, const double *values)
{
    int ls = 0, us = 0;
    for (int i = 0; i < lu->n; ++i) lu->position[i] = -1;
    if (lu->pass > 1000000000) {
        lu->pass = 0;
        memset(lu->mark, 0, (size_t)lu->n * sizeof(int));
    }
    for (int k = 0; k < lu->n; ++k) {
        const int column = lu->order[k];
        int top, pivot = -1;
        double largest = 0.0, diagonal;
        lu->l_start[k] = ls;
        lu->u_start[k] = us;
        top = column_of(lu, column, values);
        for (int p = top; p < lu->n; ++p) {
            const int row = lu->found[p];
            const double size = fabs(lu->x[row]);
            if (lu->position[row] >= 0) {
                lu->u_row[us] = lu->position[row];
                lu->u[us++] = lu->x[row];
            } else if (size > largest) {
                largest = size;
                pivot = row;
            }
        }
        if (pivot < 0 || !isfinite(largest)) return 1 + column;
        if (lu->mark[column] == lu->pass && lu->position[column] < 0 && fabs(lu->x[column]) >= DIAGONAL * largest) pivot = column;
        diagonal = lu->x[pivot];
        lu->u_row[us] = k;
        lu->u[us++] = diagonal;
        lu->position[pivot] = k;
        lu->l_row[ls] = pivot;
        lu->l[ls++] = 1.0;
        for (int p = top; p < lu->n; ++p) {
            const int row = lu->found[p];
            if (lu->position[row] < 0) {
                lu->l_row[ls] = row;
                lu->l[ls++] = lu->x[row] / diagonal;
            }
        }
        lu->l_start[k + 1] = ls;
        lu->u_start[k + 1] = us;
    }
    for (int p = 0; p < ls; ++p) lu->l_row[p] = lu->position[lu->l_row[p]];
    return 0;
}

void smpl_lu_solve(smpl_lu *lu, double *b)
{
    double *x = lu->x;
    for (int i = 0; i < lu->n; ++i) x[lu->position[i]] = b[i];
    for (int k = 0; k < lu->n; ++k) {
        for (int p = lu->l_start[k] + 1; p < lu->l_start[k + 1]; ++p) x[lu->l_row[p]] -= lu->l[p] * x[k];
    }
    for (int k = lu->n - 1; k >= 0; --k) {
        const int last = lu->u_start[k + 1] - 1;
        x[k] /= lu->u[last];
        for (int p = lu->u_start[k]; p < last; ++p) x[lu->u_row[p]] -= lu->u[p] * x[k];
    }
    for (int k = 0; k < lu->n; ++k) b[lu->order[k]] = x[k];
}
