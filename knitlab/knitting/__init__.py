"""Knitting: from a case to a stitch chart, to knitout for a machine, and checks of both."""
