"""Equilibria of a fabric: relaxed off the needles, then pulled step by step, quasi-statically.

In: a ``System`` (a fabric's energy, forces and factorised stiffness), ``Solver`` and a start. Out:
states with residual, status and number of iterations; for a test, one a strain. Read ``search.py``
(one minimisation), ``equilibrium.py`` (the equilibrium near a configuration), ``strain_path.py`` (a
path of them) and ``tensile_test.py`` (``relax``, ``stretch``). ``adjoint.py`` has derivatives of
results. Nothing here knows files, xarray or designs.
"""
