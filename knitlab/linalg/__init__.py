"""Sparse Cholesky factorisation of the stiffness of a sheet, multifrontal and block-tridiagonal."""
