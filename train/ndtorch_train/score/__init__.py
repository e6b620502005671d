"""The benchmark of visual binding: seeded random scenes, methods, metrics and the leaderboard."""
