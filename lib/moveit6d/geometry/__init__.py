"""Poses, cameras, meshes, symmetries and the look-at crop.

Never renders and never knows a network.
"""
