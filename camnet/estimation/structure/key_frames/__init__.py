"""Key frames and the camera's position over long paths, where a landmark is seen now and then (bell2019, chapter 4).

| module | what |
| --- | --- |
| `settings` | ``KeyFrameSettings``, published values |
| `relative_pose` | pose of a key frame from tracked directions, about the expected one, with covariance |
| `feature_observer` | observer and predictor of the distances, gates, history stack, dwell clock (compiled) |
| `key_frame` | ``measure_key_frame``, ``observe_key_frame``: all of a key frame's images |
| `pose_observer` | the printed observer and predictor of the pose, with resets (compiled) |
| `augmented_filter` | our filter: learns the odometry's errors, uses visual rotation and revisits (compiled) |
| `map_pose` | pose in an old key frame from its learned points seen again |
"""
