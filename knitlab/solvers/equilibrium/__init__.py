"""Equilibria of a fabric: relaxed off the needles, then pulled step by step, quasi-statically.

In: a ``System`` (a fabric's energy, forces and factorised stiffness), ``Solver`` and a
start. Out: states with residual, status and number of iterations; for a test, one a strain.

Each file uses those before it: ``state.py`` (a result), ``stiffness.py`` (its sparsity),
``subdomains.py`` (parts of a large sample), ``system.py`` (the equations), ``search.py`` (one
minimisation), ``domain_decomposition.py`` (subdomains solved in several processes),
``equilibrium.py`` (the equilibrium near a configuration), ``strain_path.py`` (a path of them) and
``tensile_test.py`` (``relax``, ``stretch``). ``contact_barrier.py`` and ``drag.py`` add their
energies, ``alignment.py`` lays a sample between clamps, and ``adjoint.py`` has derivatives of
results. Nothing here knows files, xarray or designs.
"""

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
