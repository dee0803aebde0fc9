"""Sparse Cholesky factorisation of the stiffness of a sheet by the multifrontal method.

In: a sparsity with the coordinates of its nodes, then matrices of that sparsity. Out: factors.

Read ``multifrontal.py``; ``symbolic_factorisation.py`` has nested dissection and the fronts,
``triangular_solves.py`` the solves, and ``blas.py`` the calls of BLAS and LAPACK.
"""
