"""Benchmark of the solvers: ``python -m benchmarks.solver`` in the repository.

Every measurement is made in a process of its own and leaves one small JSON file, so that a run
that was broken off goes on where it stopped. The files are gathered into one labelled cube, from
which alone the figures are drawn.
"""
