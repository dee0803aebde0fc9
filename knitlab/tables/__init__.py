"""Questions to cubes: selections, conditions, comparisons. Reads files only, never imports JAX."""
