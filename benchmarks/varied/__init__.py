"""Numbers of the diagnosis that decide and have no source: each is halved and doubled, and answers are compared."""
