"""Training of policies: imitation of a built-in agent, then PPO on the batch back end (extra ``train``)."""
