"""Constants, dwell times and verdicts: how long a target may stay unseen."""
