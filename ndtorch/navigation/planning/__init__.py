"""Planning in a local map: costmap, Dijkstra, lattice A*, and tracking of a path."""
