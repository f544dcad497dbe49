"""A target that moves before a moving camera (bell2019, chapter 5): structure, pose, velocity, prediction.

Start with `relations`, the corrected geometry, and `unseen_growth`, the lemma that had to be repaired.
"""
