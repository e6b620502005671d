"""The worlds of the BARN challenge: fields of cylinders to be crossed, each driven once."""
