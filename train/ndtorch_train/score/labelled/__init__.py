"""Video with others' truth: detection, tracks, count, masks and cost of the video model and of what people use."""
