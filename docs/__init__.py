"""The documentation's pages, and the programs that make what is generated of them."""
