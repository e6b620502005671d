"""The robot: control loop, simulated world, scoring and pictures; run from a checkout as `ndtorch`."""
