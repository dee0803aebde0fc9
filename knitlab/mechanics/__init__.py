"""How a fabric moves: equilibrium and the loadings that carry it from state to state.

This room knows nothing of files, xarray or designs.
"""
