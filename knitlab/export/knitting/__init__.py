"""Knitting: from a case to a stitch chart, to knitout for a machine, and checks of both.

In: a case, and a machine (``params/machine.toml``). Out: a chart of knits and purls with its plated
stitches, a knitout program, a specification for the knitter, and mistakes by their line.

Read ``stitch_chart.py`` (from a pattern to stitches), ``program.py`` and ``knitout.py``;
``checks.py`` and ``round_trip.py`` read a program back and compare it with its chart.
"""
