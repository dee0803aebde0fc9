"""Drawing of cubes. Reads files and never imports JAX."""
