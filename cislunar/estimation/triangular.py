"""Small triangular factorizations, compiled, in place and without exceptions."""

import numpy as np

from cislunar.compiled import njit_noalloc


@njit_noalloc
def cholesky(matrix):
    """Replace a symmetric matrix by its lower Cholesky factor; only the lower triangle is read.
    Returns False, with the matrix overwritten, if it is not positive definite or not finite."""
    n = matrix.shape[0]
    for j in range(n):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not (pivot > 0.0 and pivot < np.inf):
            return False
        pivot = np.sqrt(pivot)
        matrix[j, j] = pivot
        inverse = 1.0 / pivot
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total * inverse
            matrix[j, i] = 0.0
    return True


@njit_noalloc
def add_outer_product(upper, vector):
    """Replace an upper triangular G, with a positive diagonal, by that of G G^T + v v^T. Only
    rotations are used, so that the result is accurate for any v. v is overwritten."""
    for j in range(vector.shape[0] - 1, -1, -1):
        old = upper[j, j]
        new = np.sqrt(old * old + vector[j] * vector[j])
        cosine = old / new
        sine = vector[j] / new
        upper[j, j] = new
        for i in range(j):
            entry = upper[i, j]
            upper[i, j] = cosine * entry + sine * vector[i]
            vector[i] = cosine * vector[i] - sine * entry


@njit_noalloc
def solve_lower(lower, vector):
    """Replace a vector b by L^-1 b; only the lower triangle of L is read."""
    for i in range(vector.shape[0]):
        total = vector[i]
        for k in range(i):
            total -= lower[i, k] * vector[k]
        vector[i] = total / lower[i, i]


@njit_noalloc
def solve_transposed(lower, vector):
    """Replace a vector b by L^-T b; only the lower triangle of L is read."""
    n = vector.shape[0]
    for i in range(n - 1, -1, -1):
        total = vector[i]
        for j in range(i + 1, n):
            total -= lower[j, i] * vector[j]
        vector[i] = total / lower[i, i]
