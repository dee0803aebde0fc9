"""Inverse design: the stripes and sizes that come closest to targets.

In: a request (targets, variables with bounds, settings). Out: ranked candidates, each tested with
its perturbed copies, and the targets that contradict each other.

Read ``request.py``, ``design.py``, then ``search.py`` (one search from one start, by gradients or
without) and ``objective.py``.
"""
