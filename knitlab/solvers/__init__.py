"""One case, relaxed and pulled: equilibria, dynamics, branches, and the factorisation they share.

In: a ``Case`` (a design with all its settings). Out: a ``TensileTest``: states at the applied
strains, each with status, residual and number of iterations. Read ``case.py``, then ``equilibrium``
and ``dynamics``. Nothing here knows files or xarray.
"""
