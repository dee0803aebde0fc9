"""The paper's claims, tested on cubes, and model options ranked by them."""
