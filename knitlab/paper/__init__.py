"""The paper's claims, judged by cubes, and model options ranked by them."""
