"""Shaped pieces: fabric that relaxes to a wanted outline.

Read ``outline.py`` (what is wanted), ``piece.py`` (from an outline to a fabric, and back to its
outline) and ``fitting.py`` (the fabric is corrected until both agree).
"""
