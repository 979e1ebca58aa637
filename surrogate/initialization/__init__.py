"""Starts of the Gaussians: on points that the hook sampled, on points matched between images, or anywhere in the box.

Import the modules themselves: `structure_from_motion` takes pycolmap when it is called.
"""
