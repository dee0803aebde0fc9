"""What a fabric is: its pattern, its network of springs and hinges, and its energy.

In: a ``Pattern`` (which patch is rib, garter or plain knit, and how large), calibrated stripes, and
model options. Out: a ``Fabric``, whose ``energy`` of a ``Configuration`` (positions of its nodes)
is differentiable, with forces and second derivatives of single elements, walls, contact between
layers, and the electrodes that are plated on it.

Read ``pattern.py``, ``layout.py`` (from a pattern to a network), then ``energy.py`` (the three
formulas of the paper). Nothing here knows solvers, files or xarray.

This is the first package to import JAX, and therefore sets JAX to float64 and to computing in the
calling thread. Otherwise the computations of two calling threads would share one thread on a CPU.
"""

import jax

from knitlab.model.compiled_programs import keep_compiled_programs

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_enable_async_dispatch", False)
keep_compiled_programs()
