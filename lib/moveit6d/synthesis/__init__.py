"""Pictures with known truth: training pairs, procedural objects and scenes, whole sequences.

Never trains and never tracks.
"""
