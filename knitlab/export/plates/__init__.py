"""The plate that a periodic fabric is on average: its stiffness, and material cards of shells.

Read ``plate_stiffness.py`` (cases and cubes), then ``shell_cards.py``.
"""
