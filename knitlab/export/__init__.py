"""What leaves knitlab: stitch charts and knitting programs, meshes of shapes, and plates."""
