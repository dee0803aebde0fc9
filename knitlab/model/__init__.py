"""What a fabric is: its pattern, its network of springs and hinges, and its energy.

In: a ``Pattern``, calibrated stripes, and model options. Out: a ``Fabric``, whose ``energy`` of a
``Configuration`` (positions of its nodes) is differentiable. Read ``pattern.py``, ``layout.py``
(from a pattern to a network), then ``energy.py`` (the three formulas of the paper). Nothing here
knows solvers, files or xarray.

This is the first package to import JAX: it sets JAX to float64 and to computing in the calling
thread, as two calling threads would otherwise share one.
"""

import jax

from knitlab.model.compiled_programs import keep_compiled_programs

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_enable_async_dispatch", False)
keep_compiled_programs()
