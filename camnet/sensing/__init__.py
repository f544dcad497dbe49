"""From the true state to measurements: visibility, noise, latency, drop-outs, rates by regression.

Only this package and the world read the truth; estimators and controllers get what comes out of it.

| read | for |
| --- | --- |
| `visibility` | which camera sees which target |
| `pose_sensor` | pose measurements from what is visible |
| `rates` | velocities from measured poses |
"""
