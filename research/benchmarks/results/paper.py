"""Figures that GS-Surrogate's paper reports, on its own data: Li et al. 2026, arXiv:2604.06358."""

from __future__ import annotations

from surrogate.evaluation.tables import document, table

TEXT = """\
PSNR (dB) at unseen parameters, copied from Li et al. 2026 (arXiv:2604.06358). Its members, transfer functions, images and
processors are others than ours, so its rows say nothing about a row of ours. `cloverleaf` and `cloverleaf-large` solve the problem
of its CloverLeaf3D."""
HEADER = ("method, in the paper", "Nyx", "XCompact3D", "CloverLeaf3D")
DECIBELS = {
    "GS-Surrogate": (38.83, 41.26, 30.93),
    "4DGS-HD": (33.39, 35.23, 16.03),
    "K-Planes": (26.78, 33.05, 16.48),
    "ViSNeRF": (33.97, 33.81, 32.92),
    "InSituNet": (23.11, 24.88, 21.78),
}


def section() -> str:
    """The paper's table in Markdown, with its heading."""
    rows = [[method, *(f"{each:.2f}" for each in values)] for method, values in DECIBELS.items()]
    return document("## The paper's own figures, on its own data", TEXT.replace("\n", " "), table(HEADER, rows)).strip()
