"""Files of input and results: schemas, tables, atomic writes, locks, provenance. Imports no JAX."""
