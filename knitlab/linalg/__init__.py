"""Sparse Cholesky factorisation of a sheet's stiffness: elimination order, plan, fronts, BLAS."""
