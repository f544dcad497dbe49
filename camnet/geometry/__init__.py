"""Pure geometry: rotations, pinhole cameras, view frusta, convex regions, roads."""
