from hypothesis import settings

# A first example may compile a JAX program; speed is the benchmark's business.
settings.register_profile("knitlab", deadline=None)
settings.load_profile("knitlab")
