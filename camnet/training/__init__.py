"""Training of policies: imitation of a built-in agent, then PPO on the batch back end (extra ``train``)."""

import os as _os

# Between two calls torch's threads keep the processors busy with waiting, unless they are told to sleep before torch
# is imported. A run then takes a seventh longer on a free machine, and 0.6 times as long beside one other process.
_os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
