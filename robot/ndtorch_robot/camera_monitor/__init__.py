"""The camera monitor: before every step it decides whether the frames of both cameras can be trusted."""
