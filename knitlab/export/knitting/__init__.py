"""Knitting: from a case to a stitch chart, to knitout for a machine, and back.

Read ``stitch_chart.py`` (from a pattern to stitches) and ``knitout.py`` (from stitches to a
program). ``checks.py`` and ``round_trip.py`` read a program back and compare it with its chart;
``chart_files.py`` and ``patches.py`` read any chart as a pattern.
"""
