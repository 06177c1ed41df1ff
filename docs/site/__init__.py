"""The documentation site: pages of the repository, and those that are made of the code.

``python -m docs.site build`` writes the whole source of the site, plain Markdown and pictures, and has MkDocs turn it
into HTML. What is written uses nothing of MkDocs' programming interface, so that another generator of the same
configuration, such as Zensical, can take its place.
"""
