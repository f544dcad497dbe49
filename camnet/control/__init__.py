"""Sliding-mode pose control, C1 references and the quadrotor's inner loop."""
