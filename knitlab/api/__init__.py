"""What ``import knitlab`` offers: one function for each thing that the command line can do."""
