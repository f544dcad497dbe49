"""From the true state to measurements: visibility, noise, latency, drop-outs, rates by regression."""
