"""The simulated world behind one protocol; each engine behind one file."""
