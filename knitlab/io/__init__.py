"""Files: the schema of cubes and cases, atomic writes, locks, provenance. Imports without JAX."""
