"""Pure geometry: rotations, pinhole cameras, view frusta, regions, roads.

Everything here is a function of its arguments, in SI units, vectorised over leading dimensions; what single-point hot
paths need has a compiled kernel beside it.

| read | for |
| --- | --- |
| `rotations` | unit quaternions, scalar first; `rotations_compiled` for single ones |
| `pinhole`, `frustum` | projection with OpenCV's distortion; field-of-view volumes as half-spaces |
| `regions` | operating regions and occluders: membership, exact distances, projection, overlap |
| `roads`, `smooth_road`, `road_graph` | lines by arc length, curves a robot can follow, networks of them |
"""
