"""The documentation site: pages of the repository, and those that are made of the code.

``python -m docs.site build`` writes the whole source of the site, plain Markdown and pictures, and has MkDocs turn it
into HTML. What is written uses nothing of MkDocs' programming interface, so that another generator of the same
configuration can take its place. Material for MkDocs is maintained until May 2027. Zensical, by the same team, reads
this configuration and is to follow; its version 0.1.2 could not be installed, because zensical-ui 0.0.42, which it
needs, was in no index.
"""
