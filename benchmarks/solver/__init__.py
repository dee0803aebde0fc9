"""Methods that ``benchmarks/bench_solvers.py`` compares with knitlab's own."""
