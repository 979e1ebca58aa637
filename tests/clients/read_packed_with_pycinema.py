"""Run by pycinema's own Python: read every row's image of the packed database in argv[1], write what it saw to argv[2] (.npz).

pycinema makes an image of each file, with a channel for each appearance that holds all of a member's views.
"""

import sys

import numpy
from pycinema.filters import CinemaDatabaseReader, ImageReader

database = CinemaDatabaseReader()
database.inputs.path.set(sys.argv[1], False)
reader = ImageReader()
reader.inputs.table.set(database.outputs.table, False)
reader.inputs.file_column.set("^FILE$", False)
database.update()

table = database.outputs.table.get()
columns = [table[0].index(name) for name in ("member", "appearance", "view")]
rows = [[str(row[column]) for column in columns] for row in table[1:]]
images = reader.outputs.images.get()
numpy.savez(
    sys.argv[2],
    rows=numpy.array(rows),
    images=numpy.array(
        [image.channels[appearance][int(view)] for image, (_, appearance, view) in zip(images, rows, strict=True)]
    ),
)
