"""The explorer: cubes, their shapes and their run as one page that needs no network."""
