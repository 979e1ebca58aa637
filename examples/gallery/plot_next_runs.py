"""
The runs to simulate next
=========================

``next_runs`` suggests the runs that lower the variance of the emulated field most. ``surrogate ask next`` writes them as a table.

The run has two blobs in a box; ``blobs.py``, beside this script, makes it.
"""

import matplotlib.pyplot as plt
from blobs import make_run

from catalogs import Catalog
from surrogate.answers.next_runs import next_runs
from surrogate.emulation import EmulatedFields

catalog = Catalog.open(make_run() / "blobs.cdb")
suggested = next_runs(catalog, EmulatedFields.fit(catalog), count=5)
print(suggested.table())

plt.figure(figsize=(5, 3.5), layout="tight")
plt.plot(*zip(*(member.parameters.values() for member in catalog.members), strict=True), "o", label="members")
plt.plot(*suggested.runs.T, "r*", markersize=14, label="suggested")
plt.xlabel(catalog.plan.space.names[0])
plt.ylabel(catalog.plan.space.names[1])
plt.legend(loc="upper left")
