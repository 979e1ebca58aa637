"""Appearances that several tests of catalogs vary."""

from __future__ import annotations

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.variations import transfer_function_family

FUNCTION = TransferFunction(
    ((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.0, 0.0), (0.3, 0.2), (0.6, 0.5), (1.0, 1.0)), 0.1
)


BASE = VolumeRendering("dvr", FUNCTION)


FUNCTIONS = transfer_function_family(BASE, first_step=(0.1, 0.1), second_step=(0.1, 0.25), validation=1, test=2)


OLD_CATALOG = """{
 "schema": 2,
 "parameters": [{"name": "Re", "low": 100.0, "high": 200.0, "unit": ""}],
 "appearances": [
  {"kind": "volume", "name": "dvr",
   "transfer_function": {"color_points": [[0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]],
                         "opacity_points": [[0.0, 0.0], [1.0, 0.5]], "opacity_unit_distance": 0.1},
   "shaded": false},
  {"kind": "isosurface", "name": "iso", "isovalue": 0.25, "color": [0.85, 0.85, 0.85],
   "ambient": 0.15, "diffuse": 0.75, "specular": 0.2, "specular_power": 20.0}
 ],
 "cameras": [
  {"world_to_camera": [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 5.0], [0.0, 0.0, 0.0, 1.0]],
   "fx": 20.0, "fy": 20.0, "cx": 8.0, "cy": 6.0, "width": 16, "height": 12}
 ],
 "view_splits": ["train"],
 "bounds": [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]],
 "background": null,
 "image_format": "png",
 "images": {"memory": "premultiplied RGBA", "disk": "straight RGBA", "rows": "top first"},
 "provenance": {"bounds_from": "given"}
}"""
