"""Pure geometry: rotations, pinhole cameras, view frusta, regions, roads.

Everything here is a function of its arguments, in SI units, vectorised over leading dimensions; what single-point hot
paths need has a compiled kernel beside it.

| read | for |
| --- | --- |
| `rotations` | unit quaternions, scalar first; `rotations_compiled` for single ones |
| `pinhole`, `frustum` | projection with OpenCV's distortion; field-of-view volumes as half-spaces |
| `regions` | operating regions and occluders: membership, exact distances, projection, overlap |
| `kernel_cache`, `kernel_source` | compiled kernels on disk, for several processes at once; what each is made of |
| `roads`, `smooth_road`, `road_graph` | lines by arc length, curves a robot can follow, networks of them |
"""

from camnet.geometry.kernel_cache import notice_changes as _notice_changes
from camnet.geometry.kernel_cache import take_turns as _take_turns

_take_turns()
_notice_changes()
