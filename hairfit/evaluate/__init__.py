"""Recovered hair against true hair."""

from .evaluation import Evaluation as Evaluation
from .evaluation import evaluate as evaluate
from .match import THRESHOLDS as THRESHOLDS
from .match import Rates as Rates
from .match import Score as Score
from .match import score as score
