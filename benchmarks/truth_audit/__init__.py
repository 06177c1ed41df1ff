"""The library set to the true effect and the true numbers, against recordings of reality."""
