"""Image formation on tensors: shading, layers, blur, lens, sensor, in linear light.

Never draws a random number: training (`augmentation`) and sequences (`sequences`) hand in their
own parameters.
"""
