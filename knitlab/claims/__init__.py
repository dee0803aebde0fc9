"""The paper's claims of ``params/claims.toml``, tested on cubes, and model options ranked by them.

Read ``claims.py`` and ``judgement.py``; each claim's ``test`` is a check of ``checks.py``.
"""
