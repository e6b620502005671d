"""The robot: control loop, safety layer, cameras, drive links, simulation, recordings and views."""
