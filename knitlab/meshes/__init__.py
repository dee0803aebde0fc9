"""Meshes of a fabric for other programs: its surface or a solid, with fields, in their formats."""
