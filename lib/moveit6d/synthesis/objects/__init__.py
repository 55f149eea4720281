"""Random objects: shapes, textures, declared symmetries, and the demonstration's object.

Never renders.
"""
