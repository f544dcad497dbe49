"""Many environments at once on the CPU, without a physics engine: the same equations in compiled loops.

`network` packs a world into arrays, `state` holds the environments, `loop` steps them; `body`, `gimbal`, `reference`,
`motion`, `sense` and `book` are the parts. What agents see comes from one of `frozen`, `kalman`, `oracle` or
`estimator`. The interfaces for training are in ``camnet.env.batch_vector``.
"""

from __future__ import annotations
