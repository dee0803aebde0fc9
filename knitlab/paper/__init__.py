"""The paper's claims: what it states, each judged against cubes, and readings ranked by them."""
