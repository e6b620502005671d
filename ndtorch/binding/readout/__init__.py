"""Network state -> which objects there are: by weights, by owners, by delays."""
