"""The explorer: cubes, their shapes and their run as one HTML page that needs no network.

Read ``explorer.py``, then ``cube_content.py`` and ``shapes.py``, which pack numbers for the page;
``page`` has its scripts and styles.
"""
