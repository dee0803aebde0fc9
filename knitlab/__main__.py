"""The command line, as ``python -m knitlab``."""

from knitlab.cli import main

if __name__ == "__main__":
    main(prog_name="knitlab")
