"""The commands of ``knitlab``. Each imports what it needs as it runs, so that all start fast."""
