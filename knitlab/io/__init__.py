"""Files of input and results: read with one message that lists all mistakes, written atomically.

In: TOML, tables of numbers, text from users. Out: checked values, or ``InputError`` with every
mistake, each with its path, its value and a remedy.

Read ``errors.py``, then ``toml.py`` and ``table_file.py``. ``atomic_write.py`` and ``lock.py`` keep
a results folder whole; ``provenance.py`` says which model and libraries made a result.
Imports no JAX.
"""
