"""Frames -> signals: temporal filters, motion, orientation and the ten features."""
