"""Robots that people own: where their models lie, what their logs call things, and what is known of their gains."""
