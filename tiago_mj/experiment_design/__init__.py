"""What a recording can tell at all, before anything is fitted (``tiago-mj preflight``)."""
