"""Figures of cubes, one file a figure. Reads files only and never imports JAX."""
