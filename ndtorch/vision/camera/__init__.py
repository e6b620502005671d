"""What ordinary video needs before: exposure, background, noise, the scale of motion."""
