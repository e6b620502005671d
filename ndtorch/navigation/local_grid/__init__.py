"""What a car remembers of its surroundings for seconds: a rolling grid of evidence, and where it has just driven."""
