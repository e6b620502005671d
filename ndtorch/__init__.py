"""Insect-inspired vision and navigation in PyTorch."""
