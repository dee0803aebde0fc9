"""One case: a fabric relaxed and pulled, measured, and made a labelled dataset."""
