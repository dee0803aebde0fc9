"""The page of claims, as HTML and Markdown, with its figures."""
