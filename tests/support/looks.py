"""An appearance for commands that read one from a file."""

LOOK = """[[appearance]]
kind = "volume"
name = "dvr"
[appearance.transfer_function]
opacity_unit_distance = 1.0
color_points = [[0.0, 0.1, 0.3, 0.8], [1.0, 0.8, 0.1, 0.1]]
opacity_points = [[0.2, 0.0], [1.0, 0.6]]
"""
