"""Equilibria of a fabric: relaxed off the needles, then pulled step by step, quasi-statically.

In: a ``System`` (a fabric's energy, forces and factorised stiffness), ``Solver`` and a
start. Out: states with residual, status and number of iterations; for a test, one a strain.

Read ``tensile_test.py`` (``relax``, ``stretch``), ``strain_path.py``, which follows the states of a
test, then ``equilibrium.py`` and ``search.py``, the minimisation that all call. ``system.py`` has
the equations, ``domain_decomposition.py`` what large samples need, ``adjoint.py`` derivatives of
results. ``factorisation`` is the sparse Cholesky factorisation. Nothing here knows files, xarray
or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
