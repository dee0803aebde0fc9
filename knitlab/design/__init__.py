"""Inverse design: the stripes and sizes that come closest to targets.

Read ``request.py``, ``design.py``, then ``search.py`` (one search from one start, by gradients or
without) and ``objective.py``.
"""
