"""Meshes of a fabric for other programs, with fields: VTU, PLY, GLB, STL, OBJ or FOLD files.

Read ``fabric.py``, then ``surface.py`` and ``formats.py``.
"""
