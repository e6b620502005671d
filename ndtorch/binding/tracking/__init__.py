"""Objects over time: detections of one moment, tracks through many."""
