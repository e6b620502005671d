"""What the cameras of a simulated world see: a rasteriser for meshes and boxes, MuJoCo's own renderer for all else."""
