"""Which effects a recording can show, before anything is fitted (``tiago-mj preflight``)."""
