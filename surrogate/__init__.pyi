from surrogate.answers.posterior import invert as invert
from surrogate.answers.posterior import invert_numbers as invert_numbers
from surrogate.answers.targets import Target as Target
from surrogate.explore.server.notebook import show as show
from surrogate.model import Surrogate as Surrogate
from surrogate.model import look_at as look_at
from surrogate.settings import TrainingSettings as TrainingSettings
from surrogate.splatting import render as render
from surrogate.training.run import train as train

__version__: str
