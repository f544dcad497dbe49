"""How targets move: along a vector field, on roads, or as recorded.

The networks of parikh2018 and harris2020 learn a target's velocity as a function of its pose, so the first kind of
target obeys such a function exactly; the others are there to see what happens when it does not quite hold.

| file | what |
| --- | --- |
| `protocol` | `TargetMotion`: what every kind offers; `TargetState` |
| `vector_field` | differential-drive robot on a planar field; `fields`: two fields; `curve`: closed splines |
| `road` | vehicle that turns at random on a road network; `road_network`: the network |
| `replay` | recorded track, interpolated; `track`: the record itself |
| `factory` | settings to motion |

Everything is pure: states in, states out, generators passed in. Read `protocol`, then `vector_field`.
"""
