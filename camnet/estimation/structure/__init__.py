"""Structure and motion from one moving camera (bell2019): distances, key frames, moving targets.

Frames: ``c`` current camera, ``k`` key frame (the camera frame where an object was first seen), ``i`` feature i; camera
axes x right, y down, z forward. ``u_ic`` is the unit vector to feature i in the camera frame, ``d_ic`` its distance;
``u_kc``, ``d_kc``, ``r_kc``/``q_kc`` direction, distance and rotation of the key frame, key frame to camera frame.
Everything broadcasts over leading dimensions.

| module | what |
| --- | --- |
| `geometry` | psi, M, chi and their conditions; ``velocity_vector`` (phi) is corrected |
| `rates` | rate laws of distances, directions, positions, orientations; ``key_quaternion_rate`` is corrected |
| `tracks` | ``TrackedFrame(t_s, ids, pixels)``, the protocol ``FeatureTracks``, ``SimulatedTracks``, ``match`` |
| `camera_path` | ``CameraPath(t_s, p_world, q_world).states(t)``; ``planar_path`` for a level camera on a robot |
| `odometry` | ``OdometrySpread.draw``, ``measure_odometry``, ``Odometry.at(t)``, ``dead_reckon`` |
| `image_tracks` | ``ImageTracks(images, settings)``: the same protocol on real images |
| `two_view` | rotation and direction of a key frame: essential matrix, homography, gyro-aided |
| `key_view` | ``KeyFrameViews(camera, odometry, settings).view(frame)``: what the observers read |
| `stack`, `flow` | history stack of the distances; optical flow over a window |
| `distance_observer` | observers 1 and 2; `compiled_observer` the same, compiled |
| `inverse_depth_observer`, `inverse_depth_filter` | observers 3 and 4 |
| `moving` | a target that moves (chapter 5): a package with a table of its own |
| `bundle` | bundle adjustment of poses, inverse depths, odometry scale and gyro bias |
| `reconstruct` | path and points of many images at once (`triangulate`, `bootstrap`: its starts) |

A simulation in four lines::

    path = planar_path(t_knots, xy, camera_yaw, height_m=0.3)
    tracks = SimulatedTracks(points_world, path, Pinhole.from_settings(intrinsics), t_frames, 0.5, rng)
    odometry = measure_odometry(path, t_50hz, OdometrySpread().draw(rng), rng)
    for frame in tracks: u_ic = camera.unproject(frame.pixels); v, w = odometry.at(frame.t_s)

Everything here was derived again; what differs from print says so at the head of its file.
"""
