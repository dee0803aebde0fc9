"""Meshes of a fabric for other programs: its surface or a solid, with fields, in their formats.

In: a cube or a case file, and which state. Out: VTU, PLY, GLB, STL or FOLD files.

Read ``fabric.py``, then ``surface.py`` and ``formats.py``.
"""
