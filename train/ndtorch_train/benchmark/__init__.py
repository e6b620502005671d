"""Benchmarks: models and peers on seeded scenes, video with ground truth, random dots and stereo pairs."""
