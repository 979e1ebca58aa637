"""Where Gaussians may start that are not told by the field: on the visual hull of the pictures, or on points matched between them.

Import the modules themselves: `hull` takes scipy, `structure_from_motion` takes pycolmap when it is called.
"""
