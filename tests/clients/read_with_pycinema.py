"""Run by pycinema's own Python: read every image of the database in argv[1], write what it saw to argv[2] (.npz)."""

import sys

import numpy
from pycinema.filters import CinemaDatabaseReader, ImageReader

database = CinemaDatabaseReader()
database.inputs.path.set(sys.argv[1], False)
reader = ImageReader()
reader.inputs.table.set(database.outputs.table, False)
reader.inputs.file_column.set("^FILE$", False)
database.update()

images = reader.outputs.images.get()
table = database.outputs.table.get()
numpy.savez(
    sys.argv[2],
    header=table[0],
    rows=numpy.array([[str(cell) for cell in row] for row in table[1:]]),
    files=[str(image.meta["FILE"]) for image in images],
    images=numpy.array([image.channels["rgba"] for image in images]),
)
