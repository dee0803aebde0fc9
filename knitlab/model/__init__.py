"""What a fabric is: calibrated stripes, patch patterns, the spring network and its energies.

This package knows nothing of solvers, files or xarray. It is the first to import JAX, so it is
the one place that switches JAX to float64, and to computing in the calling thread: otherwise two
calling threads on a processor share one that computes.
"""

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_enable_async_dispatch", False)
