"""The paper's claims, tested on cubes, and model options ranked by them.

In: cubes, and the claims of ``params/claims.toml``. Out: for each claim whether it holds, by which
margin, and on which samples.

Read ``claims.py`` and ``judgement.py``; each claim's ``test`` is a check that ``checks.py``
registers.
"""
