"""Views: robots in a browser, films and figures, drawn with or without a display."""
