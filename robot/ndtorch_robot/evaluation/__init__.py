"""Evaluation of simulated drives: what was recorded, metrics, many drives, tables, plots and report pages."""
