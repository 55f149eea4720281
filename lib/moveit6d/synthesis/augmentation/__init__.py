"""Augmentation of rendered crops: random backgrounds, occluders, lights and camera effects.

Never decides how far a start pose is off.
"""
