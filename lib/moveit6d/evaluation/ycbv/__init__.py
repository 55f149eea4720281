"""Scores of YCB-Video's keyframes.

Never tracks.
"""
