"""Control of the camera agents, from decisions down to rotors.

What to do (`setpoints`), how to move there (`references`), the sliding-mode law (`sliding_mode`), what it assumes and
promises (`monitor`), and the quadrotor below it (`quadrotor`, `gimbal`). Files named ``*_kernel`` are compiled twins;
the readable versions beside them are their test oracles. Next: `camnet.simulation.loop`, where the parts meet.
"""
