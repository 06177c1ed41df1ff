"""Whatever readers may be given: valid inputs of every reader, what is done to them, and what is asked of the result.

``tests/test_fuzz.py`` tries some hundred inputs of every reader, ``tests/long/fuzz.py`` as many as it is told.
"""
