"""Many drives at once, and what they were worth together."""
