"""The plate that a periodic fabric is on average: its stiffness, and material cards of shells.

In: periodic states of a cube, of a case file or of a test. Out: membrane, coupling and bending
stiffness as a dataset, as a table, and as cards for other programs.

Read ``plate_stiffness.py`` (cases and cubes), then ``shell_cards.py``.
"""
