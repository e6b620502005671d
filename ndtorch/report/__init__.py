"""What a run leaves behind: traces, pictures, videos and recordings."""
