"""What is read off a fabric: local strain, Poisson's ratio, reaction force.

The same functions serve a simulation and laboratory markers; they know no solver and no file.
"""
