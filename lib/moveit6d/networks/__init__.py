"""Networks from patches to decisions, and their weights files.

Never knows a mesh, a camera or a renderer: tensors in, tensors out.
"""
