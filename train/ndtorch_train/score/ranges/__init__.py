"""Ranges on pictures of real stereo cameras with others' truth."""
