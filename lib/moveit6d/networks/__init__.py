"""Networks from crops to predictions, and their weights files.

Never knows a mesh, a camera or a renderer: tensors in, tensors out.
"""
