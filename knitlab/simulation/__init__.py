"""One case: a fabric is relaxed, stretched and measured; the result is a labelled dataset."""
