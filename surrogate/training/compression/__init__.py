"""Model only what a scene needs: what is stored is chosen from the data, by what validation images say it is worth.

`fit_to_need` follows stage 2; `color_degree` precedes stage 1.  Every choice is made on validation images, never on test ones,
and says what it measured (`Choice`).
"""

from surrogate.training.compression.choice import Choice, Measured, Option
from surrogate.training.compression.color_degree import choose_color_degree
from surrogate.training.compression.fitting import NEEDS, VARIED_NEEDS, Need, Needs, fit_to_need
from surrogate.training.compression.importance import importance

__all__ = [
    "NEEDS",
    "VARIED_NEEDS",
    "Choice",
    "Measured",
    "Need",
    "Needs",
    "Option",
    "choose_color_degree",
    "fit_to_need",
    "importance",
]
