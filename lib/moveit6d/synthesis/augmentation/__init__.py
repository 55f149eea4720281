"""Augmentation of rendered patches: backgrounds, occluders, light, lens and sensor effects.

Never decides how far a start pose is off.
"""
