"""What a fabric is: calibrated stripes, patch patterns, the spring network and its energies.

This package does not depend on solvers, files or xarray. It is the first to import JAX, and
therefore sets JAX to float64 and to computing in the calling thread. Otherwise the computations of
two calling threads would share one thread on a CPU. Compiled programs are kept for later processes.
"""

import jax

from knitlab.model.compiled_programs import keep_compiled_programs

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_enable_async_dispatch", False)
keep_compiled_programs()
