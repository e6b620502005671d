"""Programs that make the models and reproduce the published results. Run from a checkout: `ndtorch`."""
