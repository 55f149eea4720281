"""Synthetic videos with known poses: motion, environment, occluders, image formation, writers.

Never tracks.
"""
