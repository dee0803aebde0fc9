"""Many fabrics: design space → frozen plan → batches → per-case files → one cube.

This room knows nothing of figures. The registry and the faults are importable without JAX.
"""
