"""Slices of cubes: queries, design maps and figures. Reads files only and never imports JAX."""
