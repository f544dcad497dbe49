"""Training of policies: imitation of a built-in agent, then PPO on the batch back end (extra ``train``)."""

import os as _os

# Between two calls torch's threads keep the processors busy with waiting, unless they are told to sleep before torch
# is imported. Beside one other process on two cores a run then takes 0.6 of the time.
_os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
