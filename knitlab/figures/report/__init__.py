"""The page of claims, as HTML and Markdown, with its figures.

In: judged claims. Out: a page that says what a user may rely on, and by which margin.

Read ``content.py`` (sentences and tables), then ``page.py``, which writes them.
"""
