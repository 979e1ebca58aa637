"""The commands of the product and of the studies, as a person types them one after the other."""

from __future__ import annotations

from click.testing import CliRunner, Result

import surrogate.cli
from research.studies.__main__ import main as studies


def invoked(*words: object) -> Result:
    """The command of this name, in either group."""
    group = studies if words[0] in studies.commands else surrogate.cli.main
    return CliRunner().invoke(group, [str(word) for word in words])
