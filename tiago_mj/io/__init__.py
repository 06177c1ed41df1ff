"""Files read within bounds and written whole, and what is said of them: quoting, schemas, progress, deadlines."""
