"""Objects in a static camera's video: background model and foreground mask, tracks of its blobs, their colors."""
