"""Pure geometry: rotations, pinhole cameras, view frusta, regions, roads."""
