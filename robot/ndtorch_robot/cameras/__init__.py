"""Two cameras, or streams in their place: opening, reading in threads, pairing by time."""
