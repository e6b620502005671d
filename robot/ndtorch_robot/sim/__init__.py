"""A simulated world: buildings, a car with two cameras, and the truth about both for the scorer."""
