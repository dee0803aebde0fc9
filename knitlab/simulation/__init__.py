"""One case: a fabric is relaxed, pulled and measured; the result is a labelled dataset.

In: cases (a design with all its settings). Out: a case file for each, written atomically, with
status, residual and iterations of every state.

Read ``case.py``, ``simulate.py`` (what a worker runs), then ``measurement.py``, which returns every
variable of a case.
"""
