"""Tracking of the blobs of a foreground mask: association, splits and merges, clutter, track life cycle and masks."""
