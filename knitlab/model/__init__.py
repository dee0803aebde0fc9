"""What a fabric is: calibrated stripes, patch patterns, the spring network and its energies.

This room knows nothing of solvers, files or xarray. It is the first to import JAX, so it is
the one place that switches JAX to float64.
"""

import jax

jax.config.update("jax_enable_x64", True)
