"""The explorer: cubes, their shapes and their run as one page that needs no network.

In: cubes and their results folders. Out: one HTML file.

Read ``explorer.py``, then ``cube_content.py`` and ``shapes.py``, which pack numbers for the page;
``page`` has its scripts and styles.
"""
