"""From a plan to a cube: workers simulate what is missing, one writer builds the cube."""
