"""The binding models: which parts, in which order."""
