"""Foreground of a static camera's video: background model, illumination, shadow and morphology -> foreground mask."""
