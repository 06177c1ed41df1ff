"""What is seen: robots in a browser, films, figures, and how all of it is drawn without a display."""
