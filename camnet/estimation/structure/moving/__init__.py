"""A target that moves before a moving camera (bell2019, chapter 5): structure, pose, velocity, prediction.

| module | what |
| --- | --- |
| `relations` | the geometry of sections 5.1 and 5.2, corrected; the velocity from directions, also as printed |
| `unseen_growth` | Lemma 5.3, as printed and repaired |
| `rest` | structure and scale while the target rests, with the background, by bundle adjustment |
| `known_points` | pose on a known structure, image after image, with its covariance |
| `twist_filter` | causal filter of pose and velocity, its extrapolation (coordinated turn) and its smoother |
| `acceleration`, `observer` | acceleration model by ICL; the paper's observer and predictor, corrected |
| `never_at_rest` | scale of targets that never rest: no lateral slip, a known size, a known height |
| `size_from_motion` | the size of a followed target in the network, while it goes on |
| `replay` | prediction across gaps by earlier passages, with alternatives where the way forks |
"""
