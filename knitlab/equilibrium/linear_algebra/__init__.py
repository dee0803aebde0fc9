"""Sparse Cholesky factorisation of the stiffness of a sheet by the multifrontal method.

In: a sparsity with the coordinates of its nodes, then matrices of that sparsity. Out: factors.

Read ``multifrontal.py``; ``elimination_order.py`` has nested dissection,
``symbolic_factorisation.py`` the fronts, ``triangular_solves.py`` the solves, and ``blas.py`` the
calls of BLAS and LAPACK.
"""
